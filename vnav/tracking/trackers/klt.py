"""Points found by pyramidal Lucas-Kanade, forward and backward: 001 section 5.

Source: Bouguet 2000, "Pyramidal implementation of the Lucas Kanade feature tracker".
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core.arrays import Array, Floats
from vnav.core.frame import Features
from vnav.tracking.trackers.grey import grey_of

WINDOW_PX = 21
LEVELS = 3  # of the pyramid, above the image
STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.03)  # iterations, px
MIN_EIGENVALUE = 1e-4  # of the gradients' normal matrix, as OpenCV scales it
MAX_BACK_PX = 1.0  # between a point and where it is found again from where it was found
MAX_RESIDUAL = 12.0  # grey levels: mean over the window


class KltTracker:
    """Follows the brightness around points from one image to the next."""

    def __init__(self, color: NDArray[np.uint8], features: Features, _config: Config) -> None:
        self._grey, self._px = grey_of(color), features.keypoints_px

    def find(self, color: NDArray[np.uint8], predicted_px: Array) -> Floats:
        """See `Tracker`; a point that one image does not show is not sought in those after it."""
        grey, found = grey_of(color), np.full((len(self._px), 2), np.nan, np.float32)
        rows = np.flatnonzero(np.isfinite(self._px).all(1) & np.isfinite(predicted_px).all(1))
        if len(rows):
            px = self._px[rows]
            there, seen, residual = _follow(self._grey, grey, px, predicted_px[rows])
            back, seen_back, _ = _follow(grey, self._grey, there, px)
            good = seen & seen_back & (residual < MAX_RESIDUAL)
            good &= np.linalg.norm(back - px, axis=1) < MAX_BACK_PX
            found[rows[good]] = there[good]
        self._grey, self._px = grey, found
        return found


def _follow(
    a: NDArray[np.uint8], b: NDArray[np.uint8], px: Floats, start_px: Array | Floats
) -> tuple[Floats, NDArray[np.bool_], Floats]:
    """Where b shows points (N, 2) of a, near a first guess; which it shows, and how alike."""
    there, seen, residual = cv2.calcOpticalFlowPyrLK(
        a,
        b,
        np.ascontiguousarray(px),
        np.array(start_px, np.float32),
        winSize=(WINDOW_PX, WINDOW_PX),
        maxLevel=LEVELS,
        criteria=STOP,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        minEigThreshold=MIN_EIGENVALUE,
    )
    return np.asarray(there), np.ravel(seen) > 0, np.ravel(residual)
