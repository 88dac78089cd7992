"""Does this installation work? Versions, native libraries, each owner's self-test, the machine."""

import os
import platform
import re
import signal
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import metadata

from vnav import __version__
from vnav.caches import code_cache

# What answers for a library: the module whose self_test() uses it, "" where its version will do.
OWNERS = {
    "click": "",
    "numpy": "",
    "scipy": "",
    "numba": "vnav.compiled",
    "matplotlib": "",
    "msgspec": "",
    "opencv-contrib-python-headless": "vnav.features.sift",
    "gtsam": "vnav.optimisation.pose_graph",
    "octomap-python": "vnav.volumes.octree",
    "open3d": "vnav.volumes.tsdf",
    "scikit-learn": "vnav.vocabulary",
    "threadpoolctl": "",
}
SMALLER_BUILDS = {"open3d": "open3d-cpu"}  # same library, same import name

# Debian's and Ubuntu's packages of the system libraries that open3d's wheels expect.
SYSTEM_PACKAGES = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libidn2.so.0": "libidn2-0",
    "libstdc++.so.6": "libstdc++6",
    "libudev.so.1": "libudev1",
    "libusb-1.0.so.0": "libusb-1.0-0",
}
PATIENCE_S = 120.0  # for one self-test; they take a few seconds


@dataclass(frozen=True)
class Check:
    """One thing looked at: what was found and, where it is broken, how to mend it."""

    name: str
    ok: bool
    found: str
    mend: str = ""


def examine() -> list[Check]:
    """All checks, self-tests side by side, each in a process of its own: one may crash."""
    with ThreadPoolExecutor(_cores()) as pool:
        libraries = list(pool.map(library, OWNERS))
    return [_python(), _machine(), _cache(), *libraries]


def library(distribution: str) -> Check:
    """Whether a library is installed, of a version vnav can use, and passes its self-test."""
    version, requirement = _version(distribution), _requirement(distribution)
    if version is None:
        return Check(distribution, False, "not installed", _install(requirement))
    if not fits(version, requirement):
        found = f"{version}, but vnav needs {requirement}"
        return Check(distribution, False, found, _install(requirement))
    owner = OWNERS[distribution]
    failure = self_test(owner) if owner else ""
    if failure:
        name = SMALLER_BUILDS.get(distribution, distribution)
        repair = mend(failure, f"{name}=={version}")
        return Check(distribution, False, f"{version}, {failure}", repair)
    return Check(distribution, True, version + (", self-test passed" if owner else ""))


def fits(version: str, requirement: str) -> bool:
    """Whether a version lies in the bounds of a requirement, as in ``numpy>=2.0,<3``."""
    at, bounds = _numbers(version), re.findall(r"(>=|<)([\d.]+)", requirement)
    return all(at >= _numbers(end) if sign == ">=" else at < _numbers(end) for sign, end in bounds)


def _numbers(version: str) -> list[int]:
    """The numbers that a version begins with, without zeros at the end: 4.3.0 is 4.3."""
    numbers = [int(number) for number in re.findall(r"\d+", version.partition("+")[0])]
    while numbers and not numbers[-1]:
        numbers.pop()
    return numbers


def self_test(owner: str) -> str:
    """Why a module's self_test() fails in a process of its own; empty where it passes."""
    code = f"import importlib; importlib.import_module({owner!r}).self_test()"
    command = [sys.executable, "-P", "-c", code]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=PATIENCE_S, check=False
        )
    except subprocess.TimeoutExpired:
        return f"self-test of {owner} not done after {PATIENCE_S:.0f} s"
    if done.returncode < 0:
        return f"self-test of {owner} died of {signal.Signals(-done.returncode).name}"
    lines: Sequence[str] = done.stderr.strip().splitlines() or ["no reason given"]
    return lines[-1] if done.returncode else ""


def mend(failure: str, requirement: str) -> str:
    """What to do about a failed self-test of the library that this requirement installs."""
    missing = re.search(r"(lib\S+\.so[.\d]*): cannot open shared object", failure)
    if missing is None:
        return _install(requirement)
    package = SYSTEM_PACKAGES.get(missing[1])
    if package is None:
        return f"install the system library {missing[1]}"
    return f"sudo apt-get install {package}"


def _python() -> Check:
    found = f"{__version__}, Python {platform.python_version()}, {sys.prefix}"
    return Check("vnav", True, found)


def _machine() -> Check:
    page = os.sysconf("SC_PAGE_SIZE")
    total, free = (os.sysconf(name) * page / 1e9 for name in ("SC_PHYS_PAGES", "SC_AVPHYS_PAGES"))
    found = f"{_cores()} cores, {total:.1f} GB memory ({free:.1f} GB unused), {platform.machine()}"
    return Check("machine", True, found)


def _cache() -> Check:
    """Where compiled code is kept."""
    folder = code_cache()
    if folder is None:
        found = "nowhere to keep compiled code: every run compiles anew, for about a minute"
        return Check("cache", True, found, "set NUMBA_CACHE_DIR to a folder that you can write")
    return Check("cache", True, f"compiled code is kept in {folder}")


def _cores() -> int:
    return len(os.sched_getaffinity(0))


def _version(distribution: str) -> str | None:
    for name in (distribution, SMALLER_BUILDS.get(distribution, distribution)):
        try:
            return metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return None


def _requirement(distribution: str) -> str:
    """What vnav asks for of a library, with its bounds."""
    name = SMALLER_BUILDS.get(distribution, distribution)
    try:
        wanted = metadata.requires("vnav-rgbd") or []
    except metadata.PackageNotFoundError:
        wanted = []
    return next((line for line in _plain(wanted) if re.split(r"[<>=]", line)[0] == name), name)


def _plain(requirements: Sequence[str]) -> list[str]:
    """Requirements without the conditions under which they hold, and not those of extras."""
    parts = (line.partition(";") for line in requirements if "extra ==" not in line)
    return [requirement.strip() for requirement, _, _ in parts]


def _install(requirement: str) -> str:
    return f"{sys.executable} -m pip install --force-reinstall '{requirement}'"
