"""Where depth jumps from a near surface to what lies behind it."""

import numpy as np
from numpy.typing import NDArray

JUMP = 0.1  # of the nearer depth
GAP_PX = 12  # of pixels without depth, as they lie beside edges, is bridged
WAYS = ("right", "left", "below", "above")


def depth_edges(depth_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Pixels (4, H, W) of near surfaces that end there: right, left, below, above is farther.

    Pixels without depth, 0, count as what lies behind them where that is near by.
    """
    edges = np.zeros((len(WAYS), *depth_m.shape), np.bool_)
    _along_rows(depth_m, edges[0], edges[1])
    _along_rows(depth_m.T, edges[2].T, edges[3].T)
    return edges


def _along_rows(
    depth_m: NDArray[np.float32], ends: NDArray[np.bool_], begins: NDArray[np.bool_]
) -> None:
    """Mark the pixels at which a near surface ends, or begins, along its row."""
    row, column = np.nonzero(depth_m > 0)
    z = depth_m[row, column]
    beside = (np.diff(row) == 0) & (np.diff(column) <= GAP_PX)
    farther = beside & (np.diff(z) > JUMP * z[:-1])
    nearer = beside & (-np.diff(z) > JUMP * z[1:])
    ends[row[:-1][farther], column[:-1][farther]] = True
    begins[row[1:][nearer], column[1:][nearer]] = True
