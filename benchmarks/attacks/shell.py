"""A command as a shell runs it: a process of its own, and what that may suffer."""

import ctypes
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from attacks.attempt import Disturbance, Result
from attacks.worker import name_of

VNAV = Path(sys.executable).with_name("vnav")
PR_CAPBSET_DROP, OVERRIDES = 24, (1, 2)  # by which root may write and read what it pleases
DESCRIPTORS = {"stdin": 0, "stdout": 1, "stderr": 2}


def run(
    arguments: Sequence[str],
    folder: Path,
    seconds: float,
    suffered: Disturbance = Disturbance(),  # noqa: B008 - it is frozen
) -> Result:
    """What a command in a folder came to."""
    changed = {**os.environ, **suffered.environment}
    environment = {name: value for name, value in changed.items() if value is not None}
    process = subprocess.Popen(
        [str(VNAV), *arguments],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,  # no files, for their size may be limited
        stderr=subprocess.PIPE,
        preexec_fn=before(suffered),
        start_new_session=True,
    )
    said, ended = waited(process, seconds, suffered)
    if not ended and process.returncode < 0:
        ended = f"a crash: {name_of(process.returncode)}"
    out, err = (text.decode("utf-8", "replace") for text in said)
    return Result(process.returncode, out, err, ended)


def waited(
    process: "subprocess.Popen[bytes]", seconds: float, suffered: Disturbance
) -> tuple[tuple[bytes, bytes], str]:
    """What a process says, with a signal meanwhile; what ended it where it did not itself."""
    begun = time.monotonic()
    try:
        if suffered.signal_s is not None:
            try:
                return process.communicate(timeout=suffered.signal_s), ""
            except subprocess.TimeoutExpired:
                process.send_signal(suffered.signal)
        left_s = max(1.0, seconds - (time.monotonic() - begun))
        return process.communicate(timeout=left_s), ""
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return process.communicate(), f"a hang: more than {seconds:g} s"


def before(suffered: Disturbance) -> Callable[[], None]:
    """What the process does to itself before it becomes vnav."""
    libc = ctypes.CDLL(None)

    def prepare() -> None:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        for number, most in suffered.limits.items():
            resource.setrlimit(number, (most, most))
        for name, file in suffered.streams.items():
            if file == "closed":
                os.close(DESCRIPTORS[name])
            else:
                os.dup2(os.open(file, os.O_RDWR), DESCRIPTORS[name])
        if suffered.unprivileged:
            for capability in OVERRIDES:
                libc.prctl(PR_CAPBSET_DROP, capability)

    return prepare
