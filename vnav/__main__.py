"""The command line, as ``vnav`` and as ``python -m vnav``."""

import gc
import os
import signal
import sys
import time
from types import FrameType

from vnav.errors import INTERRUPTED, INTERRUPTION

ONCE_S = 1.0  # interruptions within are one: some programs send it twice


def run() -> int:
    """Run the command line; its exit code. An interruption is told while it is loaded, too.

    No garbage is sought among what is being loaded, nor among all there is when the process ends.
    """
    gc.disable()
    _interrupt_once()
    code = INTERRUPTED
    try:
        from vnav.cli.main import main

        code = main()
    except (KeyboardInterrupt, SystemError) as error:  # that compiled code makes of the other
        if not any(isinstance(e, KeyboardInterrupt) for e in (error, error.__cause__)):
            raise
        sys.stderr.write(f"{INTERRUPTION}\n")
    finally:
        gc.disable()
        gc.freeze()
    if code == INTERRUPTED:
        signal.signal(signal.SIGINT, lambda *_: os._exit(code))  # threads may take a while to end
    return code


def _interrupt_once() -> None:
    """Let the first interruption end the command in order, and one after a while at once.

    What comes meanwhile would break off the tidying up. A shell's background job has none.
    """
    first_s: list[float] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        if not first_s:
            first_s.append(time.monotonic())
            raise KeyboardInterrupt
        if time.monotonic() - first_s[0] > ONCE_S:
            os.write(sys.stderr.fileno(), f"{INTERRUPTION}\n".encode())
            os._exit(INTERRUPTED)

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)


if __name__ == "__main__":
    sys.exit(run())
