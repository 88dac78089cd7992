"""The command line, as ``vnav`` and as ``python -m vnav``."""

import sys

INTERRUPTED = 130  # exit code, as shells have it


def run() -> int:
    """Run the command line; its exit code. An interruption is told while it is loaded, too."""
    try:
        from vnav.cli.main import main

        return main()
    except KeyboardInterrupt:
        sys.stderr.write("vnav: interrupted; what was finished is kept\n")
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(run())
