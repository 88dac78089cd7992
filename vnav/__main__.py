"""The command line, as ``vnav`` and as ``python -m vnav``."""

import gc
import sys

INTERRUPTED = 130  # exit code, as shells have it


def run() -> int:
    """Run the command line; its exit code. An interruption is told while it is loaded, too.

    No garbage is sought among what is being loaded, nor among all there is when the process ends.
    """
    gc.disable()
    try:
        from vnav.cli.main import main

        return main()
    except KeyboardInterrupt:
        sys.stderr.write("vnav: interrupted; what was finished is kept\n")
        return INTERRUPTED
    finally:
        gc.disable()
        gc.freeze()


if __name__ == "__main__":
    sys.exit(run())
