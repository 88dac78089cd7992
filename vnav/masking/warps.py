"""Where the blocks of a frame were in the frame before: by depth and pose, or by a homography."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array, Floats
from vnav.core.reduced_frame import ReducedFrame

HIDDEN = 0.05  # relative inverse depth: what was so much nearer hid the surface that is seen now
CORNERS, CORNER_QUALITY, CORNER_DISTANCE = 400, 0.01, 4.0
MAX_ERROR = 0.75  # blocks of 4 px: 3 px
CONFIDENCE = 0.995
MIN_INLIERS, MIN_INLIER_SHARE = 20, 0.5

Warp = Callable[[ReducedFrame, ReducedFrame, Array], Floats | None]


def by_depth(last: ReducedFrame, current: ReducedFrame, T_last_current: Array) -> Floats:
    """Places (h, w, 2) in the last frame, in its blocks; NaN where it did not see the surface.

    Blocks without depth are as far as the nearest ones that have it; in a frame without any depth
    all are at infinity.
    """
    everywhere = filled(current.inverse_depth)
    depths = everywhere, current.inverse_depth, last.inverse_depth
    return _places_before(*depths, T_last_current, current.intrinsics.pinhole)


@compiled
def _places_before(
    filled: Floats, inverse_depth: Floats, last: Floats, T: Array, camera: Array
) -> NDArray[np.float32]:
    height, width = filled.shape
    fx, fy, cx, cy = camera
    places = np.full((height, width, 2), np.nan, np.float32)
    for v in range(height):
        for u in range(width):
            x, y, w = (u - cx) / fx, (v - cy) / fy, filled[v, u]
            z = T[2, 0] * x + T[2, 1] * y + T[2, 2] + T[2, 3] * w
            if z <= 0:
                continue
            column = fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] + T[0, 3] * w) / z + cx
            row = fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] + T[1, 3] * w) / z + cy
            if inverse_depth[v, u] > 0 and 0 <= column + 0.5 < width and 0 <= row + 0.5 < height:
                before = last[int(row + 0.5), int(column + 0.5)]
                if before > w / z * (1 + HIDDEN):
                    continue
            places[v, u, 0], places[v, u, 1] = column, row
    return places


def by_homography(last: ReducedFrame, current: ReducedFrame, _motion: Array) -> Floats | None:
    """Places (h, w, 2) by the homography of tracked corners: 003 S31, S32.

    None where too few agree with it. It holds for a plane or a rotation only.
    """
    images = [np.clip(np.rint(f.grey), 0, 255).astype(np.uint8) for f in (current, last)]
    corners = cv2.goodFeaturesToTrack(images[0], CORNERS, CORNER_QUALITY, CORNER_DISTANCE)
    if corners is None or len(corners) < MIN_INLIERS:
        return None
    tracked, found, _ = cv2.calcOpticalFlowPyrLK(images[0], images[1], corners, np.array([]))
    kept = found.ravel() > 0
    if kept.sum() < MIN_INLIERS:
        return None
    H, inliers = cv2.findHomography(
        corners[kept], tracked[kept], cv2.RANSAC, MAX_ERROR, confidence=CONFIDENCE
    )
    if H is None or inliers.sum() < max(MIN_INLIERS, MIN_INLIER_SHARE * kept.sum()):
        return None
    rows, columns = np.indices(current.grey.shape)
    pixels = np.stack([columns, rows], -1).reshape(-1, 1, 2).astype(np.float64)
    places = cv2.perspectiveTransform(pixels, H).reshape(*current.grey.shape, 2)
    return np.asarray(places, np.float32)


WARPS: dict[str, Warp] = {"depth": by_depth, "homography": by_homography}


def filled(values: Floats) -> Floats:
    """Each 0 of an image (h, w) as the nearest value that is none, 0 where all are."""
    unknown: NDArray[np.uint8] = (values == 0).astype(np.uint8)
    if unknown.all() or not unknown.any():
        return values
    _, labels = cv2.distanceTransformWithLabels(
        unknown, cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    value_of = np.zeros(labels.max() + 1, np.float32)
    value_of[labels[unknown == 0]] = values[unknown == 0]
    return np.asarray(value_of[labels])
