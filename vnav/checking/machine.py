"""Whether there is room for the libraries that a map is made with."""

import resource

from vnav.errors import VnavError

LEAST_BYTES = 2_500_000_000  # of address space, as a small map takes; most of it are libraries


def require_address_space() -> None:
    """VnavError where a limit leaves too little: OpenBLAS would ask for memory for ever."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < LEAST_BYTES:
        raise VnavError(
            f"expected at least {LEAST_BYTES / 1e9:.1f} GB of address space to make a map, found a"
            f" limit of {limit / 1e9:.1f} GB; raise it with 'ulimit -v'"
        )
