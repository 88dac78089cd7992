"""The keyframes of a map as images with known cameras, for tools that take such images."""

import numpy as np
from numpy.typing import NDArray

from vnav.core.mapping import Landmarks
from vnav.core.posed_images import PosedImage, PosedImages
from vnav.io.store.artifacts import (
    load_keyframe_color,
    load_odometry,
    load_optimised,
    map_cameras,
    require_features,
)
from vnav.io.store.map_folder import MapFolder


def load_posed_keyframes(folder: MapFolder) -> PosedImages:
    """All keyframes that have a pose, their keypoints, and the landmarks that they see."""
    odometry, optimised = load_odometry(folder), load_optimised(folder)
    poses, seen = optimised.T_world_camera, optimised.landmarks
    where = folder.root / "optimise" / "map.npz"
    require_features(odometry, seen.keyframe, seen.feature, where)
    images = tuple(
        PosedImage(
            number,
            keyframe.row,
            int(odometry.frames.capture[keyframe.row]),
            poses[keyframe.row],
            keyframe.features.keypoints_px,
        )
        for number, keyframe in enumerate(odometry.keyframes)
        if np.isfinite(poses[keyframe.row]).all()
    )
    cameras = tuple(map_cameras(folder))
    return PosedImages(cameras, images, seen, _colors(folder, images, seen))


def _colors(
    folder: MapFolder, images: tuple[PosedImage, ...], seen: Landmarks
) -> NDArray[np.uint8]:
    """Colour (L, 3) of each landmark where the first keyframe sees it."""
    colors = np.zeros((len(seen), 3), np.uint8)
    landmark, first = np.unique(seen.landmark, return_index=True)
    for image in images:
        is_here = seen.keyframe[first] == image.number
        if not is_here.any():
            continue
        color = load_keyframe_color(folder, image.row)
        keypoints_px = image.keypoints_px[seen.feature[first[is_here]]]
        corner = np.array(color.shape[1::-1]) - 1
        column, row = np.clip(np.rint(keypoints_px).astype(int), 0, corner).T
        colors[landmark[is_here]] = color[row, column]
    return colors
