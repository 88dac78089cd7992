"""Runs the Dockerfile in a bare Debian, where there is no docker.

    python3 .ci/dockerfile_in_chroot.py FOLDER [ARGUMENT...]

FOLDER becomes the file system that an image would have; where this Dockerfile has made it, it is
kept: remove it after a change of vnav. Then the entry point runs, with the ARGUMENTs if there are
any. It takes root, debootstrap, unshare and a mirror of Debian.
"""

import argparse
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

CHECKOUT = Path(__file__).parent.parent
MIRROR = "http://deb.debian.org/debian"
PASSED_ON = ("PIP_INDEX_URL", "PIP_CERT", "http_proxy", "https_proxy", "no_proxy")
CERTIFICATES = "/certificates.pem"
PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
FILES = ("FROM", "COPY", "RUN")  # what changes the file system
MOUNTED = (
    'mount -t proc proc "$0/proc" && mount --rbind /dev "$0/dev" && mount --rbind /sys "$0/sys"'
    ' && exec chroot "$@"'
)


@dataclass
class Image:
    """A file system, and what later lines take from earlier ones."""

    root: Path
    user: str = "root"
    workdir: str = "/"
    environment: dict[str, str] = field(default_factory=lambda: {"PATH": PATH})
    entry: list[str] = field(default_factory=list)
    arguments: list[str] = field(default_factory=list)

    def carry_out(self, instruction: str, value: str) -> None:
        """Do what a line says; ValueError where this script does not know how."""
        match instruction:
            case "FROM":
                self._lay_ground(value)
            case "COPY":
                self._copy(*value.split())
            case "RUN":
                self.run(["/bin/sh", "-c", value])
            case "ENV":
                self.environment.update(pair.split("=", 1) for pair in shlex.split(value))
            case "USER":
                self.user = value
            case "WORKDIR":
                self.workdir = value
                self._inside(value).mkdir(parents=True, exist_ok=True)
            case "ENTRYPOINT":
                self.entry = json.loads(value)
            case "CMD":
                self.arguments = json.loads(value)
            case _:
                raise ValueError(f"expected an instruction that is known here, found {instruction}")

    def run(self, command: list[str]) -> None:
        """Run a command inside, with /proc, /dev and /sys while it lasts; exit if it fails."""
        environment = [f"{name}={value}" for name, value in self.environment.items()]
        there = ["/bin/sh", "-c", 'cd "$0" && exec "$@"', self.workdir, *command]
        chroot = [f"--userspec={self.user}:{self.user}", str(self.root)]
        inside = [*chroot, "/usr/bin/env", "-i", *environment, *there]
        mounted = ["unshare", "--mount", "sh", "-c", MOUNTED, self.root]
        if code := subprocess.run([*mounted, *inside]).returncode:
            sys.exit(code)

    def _lay_ground(self, base: str) -> None:
        """A Debian as small as its slim image; the network and the registry as they are here."""
        suite = re.fullmatch(r"debian:(\w+)-slim", base)
        if suite is None:
            raise ValueError(f"expected FROM debian:SUITE-slim, found {base}")
        subprocess.run(
            ["debootstrap", "--variant=minbase", suite[1], self.root, MIRROR], check=True
        )
        self.environment.update({k: os.environ[k] for k in PASSED_ON if k in os.environ})
        if "PIP_CERT" in self.environment:  # where Debian's own certificates do not replace it
            shutil.copy(self.environment["PIP_CERT"], self._inside(CERTIFICATES))
            self.environment["PIP_CERT"] = CERTIFICATES
        for path in ("/etc/resolv.conf", "/etc/hosts"):
            shutil.copy(path, self._inside(path))

    def _copy(self, *paths: str) -> None:
        """Files and folders of the checkout."""
        *sources, target = paths
        self._inside(target).mkdir(parents=True, exist_ok=True)
        for source in (CHECKOUT / name for name in sources):
            if source.is_dir():
                shutil.copytree(source, self._inside(target), dirs_exist_ok=True)
            else:
                shutil.copy(source, self._inside(target))

    def _inside(self, path: str) -> Path:
        return self.root / path.lstrip("/")


def instructions(dockerfile: str) -> list[tuple[str, str]]:
    """Instruction and value of each line of a Dockerfile; continued lines are one."""
    kept = [line for line in dockerfile.splitlines() if not line.lstrip().startswith("#")]
    lines = "\n".join(kept).replace("\\\n", " ").splitlines()
    return [(name, value.strip()) for name, _, value in (s.partition(" ") for s in lines if s)]


def main() -> None:
    """Carry out every line, then run the entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("arguments", nargs=argparse.REMAINDER)
    asked = parser.parse_args()
    image, text = Image(asked.folder.resolve()), (CHECKOUT / "Dockerfile").read_text("utf-8")
    made_of = image.root / "Dockerfile"
    is_made = made_of.is_file() and made_of.read_text("utf-8") == text
    for instruction, value in instructions(text):
        if not (is_made and instruction in FILES):
            print(f"{instruction} {value}", flush=True)
            image.carry_out(instruction, value)
    made_of.write_text(text, "utf-8")
    image.run([*image.entry, *(asked.arguments or image.arguments)])


if __name__ == "__main__":
    main()
