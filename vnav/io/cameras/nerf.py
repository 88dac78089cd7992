"""transforms.json of NeRF tools: instant-ngp, nerfstudio, and the original's camera_angle_x.

Its origin is the corner of the image. ``integer_depth_scale`` (instant-ngp) is metres a unit of
depth; nerfstudio stores depth in millimetres, which frames with ``depth_file_path`` have.

Source: instant-ngp's nerf_loader.cu; https://docs.nerf.studio/quickstart/data_conventions.html,
cameras.py (get_image_coords) of nerfstudio; Mildenhall et al. 2020, load_blender.py.
"""

import math
from collections.abc import Mapping
from typing import Any

from vnav.io.cameras.tables import Tables, brown_conrady, from_corner, is_number

NAME = "NeRF"
FILES: tuple[str, ...] = ("transforms.json",)

_KEYS = {"fl_x": "fx", "fl_y": "fy", "cx": "cx", "cy": "cy"}
_DISTORTION = ("k1", "k2", "p1", "p2", "k3", "k4")
_OF_A_CAMERA = {"w", "h", *_KEYS, *_DISTORTION, "camera_angle_x", "camera_angle_y"}
_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE")
_LEAST_ANGLE = 1e-3  # radians; no lens sees less
_MILLIMETRES = 1000.0


def recognises(content: Any) -> bool:
    """Whether it has a focal length or an angle of view under their names, or frames that do."""
    if not isinstance(content, dict):
        return False
    sources = (content, *_frames(content)[:1])
    return any(key in source for source in sources for key in ("fl_x", "camera_angle_x"))


def tables(content: Any) -> Tables:
    """The camera that all frames share, and the units of depth where they are known.

    ValueError where frames have cameras of their own, or a model that is not OpenCV's.
    """
    camera = _shared(content)
    model = content.get("camera_model", "OPENCV")
    if model not in _MODELS or content.get("is_fisheye"):
        raise ValueError(
            f"expected a camera_model of {', '.join(_MODELS)}, found {model}; undistort the images"
        )
    width, height = _side(camera, "w"), _side(camera, "h")
    color: dict[str, Any] = {"width": width, "height": height, "cx": width / 2, "cy": height / 2}
    color |= _focal(camera, "fx", "camera_angle_x", width)
    color |= _focal(camera, "fy", "camera_angle_y", height)
    color |= {ours: camera[key] for key, ours in _KEYS.items() if key in camera}
    if "fx" in color:
        color.setdefault("fy", color["fx"])
    color["distortion"] = brown_conrady([camera.get(key, 0) for key in _DISTORTION], model)
    return {"color": from_corner(color)} | _depth(content)


def _frames(content: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    frames = content.get("frames")
    return [one for one in frames if isinstance(one, dict)] if isinstance(frames, list) else []


def _shared(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """What describes the camera: of the file, else what all frames agree on."""
    each = [{key: one[key] for key in _OF_A_CAMERA & one.keys()} for one in _frames(content)]
    if any(one != each[0] for one in each):
        raise ValueError(
            "expected one camera for all frames, found frames whose fl_x, cx or others differ"
        )
    return {**content, **(each[0] if each else {})}


def _side(camera: Mapping[str, Any], key: str) -> int:
    """A number of pixels, which some of these tools write as 640.0."""
    value = camera.get(key)
    if not is_number(value) or value != round(value):
        raise ValueError(f"expected the images' size in pixels as w and h, found {key} = {value!r}")
    return int(value)


def _focal(camera: Mapping[str, Any], key: str, angle: str, side_px: int) -> dict[str, float]:
    """A focal length from an angle of view, nothing where none is told."""
    value = camera.get(angle)
    if not is_number(value) or not _LEAST_ANGLE < value < math.pi:
        return {}
    return {key: side_px / (2 * math.tan(value / 2))}


def _depth(content: Mapping[str, Any]) -> Tables:
    scale = content.get("integer_depth_scale")
    if is_number(scale) and scale > 0:
        return {"depth": {"units_per_metre": 1 / scale}}
    frames = _frames(content)
    if frames and all("depth_file_path" in one for one in frames):
        return {"depth": {"units_per_metre": _MILLIMETRES}}
    return {}
