"""Statistics that outliers do not reach."""

import numpy as np
from numpy.typing import NDArray

MEDIAN_TO_SIGMA = 1.4826  # of a normal distribution


def robust_sigma(
    off: NDArray[np.float64], axis: int | tuple[int, ...] | None = None
) -> NDArray[np.float64]:
    """Standard deviation of normal errors about zero, by the median of their size; NaN count not.

    NaN where there are none.
    """
    return np.asarray(MEDIAN_TO_SIGMA * np.nanmedian(np.abs(off), axis=axis))
