"""The 7-Scenes format: frame-000000.color.png, .depth.png and .pose.txt in one folder.

It has no times, so frames are ``1 / frame_rate_hz`` apart. Its poses are those of the depth camera
and its depth is not registered to colour.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vnav.config import CaptureConfig
from vnav.core import se3
from vnav.core.association import associate
from vnav.core.camera import Camera
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError, TrajectoryError
from vnav.io.files import read_text
from vnav.io.sources.frame_list import FrameList, ImageFile, paired

NAME = "7-Scenes"
LAYOUT = "frame-000000.color.png and frame-000000.depth.png"

_ROUNDED = 1e-3  # how far a printed rotation may be from orthonormal


def recognises(root: Path) -> bool:
    """Whether the folder has an image named as this format does."""
    return any(next(root.glob(f"frame-*.{kind}.png"), None) for kind in ("color", "depth"))


def list_frames(root: Path, config: CaptureConfig) -> FrameList:
    """Colour and depth images of the same number."""
    colors = _images(root, "color", config.frame_rate_hz)
    depths = _images(root, "depth", config.frame_rate_hz)
    color_s, depth_s = (np.array([file.stamp_s for file in files]) for files in (colors, depths))
    matches = associate(color_s, depth_s, 0.5 / config.frame_rate_hz)
    if not len(matches):
        raise CaptureError(
            f"expected colour and depth images of the same number in {root}, found none among"
            f" {len(colors)} *.color.png and {len(depths)} *.depth.png"
        )
    return paired(colors, depths, matches)


def truth_path(root: Path, frames: FrameList) -> Path | None:
    """The first frame's pose file, None where it has none."""
    path = _pose_path(frames.pairs[0].color)
    return path if path.is_file() else None


def read_truth(path: Path, frames: FrameList, camera: Camera) -> Trajectory:
    """The true trajectory of the colour camera, from the poses of the depth camera.

    Where ``T_color_depth`` is unknown the two are taken to be the same. Frames without a pose, or
    whose pose is not finite (tracking was lost), are left out.
    """
    T_depth_color = np.eye(4)
    if camera.T_color_depth is not None:
        T_depth_color = se3.inverse(camera.T_color_depth)
    colors = [pair.color for pair in frames.pairs if _pose_path(pair.color).is_file()]
    T_world_depth = np.array([_read_pose(_pose_path(color)) for color in colors]).reshape(-1, 4, 4)
    known = np.isfinite(T_world_depth).all((1, 2))
    stamps_s = np.array([color.stamp_s for color in colors])
    return Trajectory(stamps_s[known], T_world_depth[known] @ T_depth_color)


def _images(root: Path, kind: str, rate_hz: float) -> list[ImageFile]:
    numbered = [(path.name.split(".")[0].removeprefix("frame-"), path) for path in root.iterdir()]
    suffix = f".{kind}.png"
    chosen = [(int(n), p) for n, p in numbered if n.isdecimal() and p.name.endswith(suffix)]
    return [ImageFile(number / rate_hz, path) for number, path in sorted(chosen)]


def _pose_path(color: ImageFile) -> Path:
    return color.path.with_name(color.path.name.replace(".color.png", ".pose.txt"))


def _read_pose(path: Path) -> NDArray[np.float64]:
    try:
        T = np.array([line.split() for line in read_text(path).splitlines()], float)
    except (OSError, ValueError) as error:
        raise TrajectoryError(f"expected a 4x4 pose in {path}, found: {error}") from error
    if T.shape != (4, 4):
        raise TrajectoryError(f"expected a 4x4 pose in {path}, found {T.size} numbers")
    if not np.isfinite(T).all():
        return T
    if not se3.is_rigid(T, _ROUNDED):
        raise TrajectoryError(
            f"expected a rotation and a translation in {path}, found {T.tolist()}"
        )
    return se3.orthonormal(T)
