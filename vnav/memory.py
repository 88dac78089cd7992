"""What this process does with memory that is freed: images come and go a hundred times a second.

glibc returns large blocks to the system at once, and takes them back page by page. A program may
have it keep them; a library leaves that to its program. Elsewhere nothing is done.
"""

import ctypes

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # mallopt(3)
LARGE, MOST_KEPT = 32 << 20, 256 << 20  # bytes: of a block that is not kept, and of what is


def keep_freed() -> None:
    """Keep freed blocks for the next ones, until `return_freed`; for the process, for good."""
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        libc.mallopt(MMAP_THRESHOLD, LARGE)
        libc.mallopt(TRIM_THRESHOLD, MOST_KEPT)


def return_freed() -> None:
    """Return to the system what is free."""
    libc = ctypes.CDLL(None)
    if hasattr(libc, "malloc_trim"):
        libc.malloc_trim(0)
