"""Raw images to what the rest of vnav works on: undistorted colour, depth in metres on its pixels.

Undistorting keeps focal lengths and principal point. Depth that is not registered is warped into
the colour camera as a surface with a z-buffer: accurate below a pixel, nothing filled in where
nothing was measured. Specks of depth are left out before.
"""

import dataclasses
from functools import lru_cache
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import Camera, Intrinsics
from vnav.core.frame import Frame

_SATURATED = 65535  # what 7-Scenes writes for "no depth"; no sensor measures it

Maps = tuple[NDArray[np.int16], NDArray[np.uint16]]
StoredDepth = NDArray[np.uint16] | NDArray[np.float32]  # (H, W), in units of the camera


def rectified(camera: Camera) -> Intrinsics:
    """The colour camera of the frames that a capture delivers: as described, without distortion."""
    return dataclasses.replace(camera.color, distortion=())


def resampled(frame: Frame, intrinsics: Intrinsics) -> Frame:
    """The frame as another pinhole camera at the same place and of the same axes sees it.

    Colour linearly, depth from the nearest pixel; beyond the image colour repeats its border and
    there is no depth. The frame itself where its camera is that one already.
    """
    own = frame.intrinsics
    if own == intrinsics:
        return frame
    frame_from_wanted = (own.K @ np.linalg.inv(intrinsics.K))[:2]
    linear, nearest = (how | cv2.WARP_INVERSE_MAP for how in (cv2.INTER_LINEAR, cv2.INTER_NEAREST))

    def of_nearest(image: NDArray[Any]) -> NDArray[Any]:
        warped = cv2.warpAffine(image, frame_from_wanted, intrinsics.size, flags=nearest)
        return np.asarray(warped)

    color = cv2.warpAffine(
        np.asarray(frame.color),
        frame_from_wanted,
        intrinsics.size,
        flags=linear,
        borderMode=cv2.BORDER_REPLICATE,
    )
    depth_m = of_nearest(np.asarray(frame.depth_m))
    hidden = None if frame.hidden is None else of_nearest(frame.hidden.astype(np.uint8)) > 0
    return dataclasses.replace(
        frame, color=color, depth_m=depth_m, intrinsics=intrinsics, hidden=hidden
    )


@lru_cache(4)  # each is some megabytes where depth is not registered
def rectifier(camera: Camera) -> "Rectifier":
    """That of a camera; the last few are kept."""
    return Rectifier(camera)


class Rectifier:
    """Undistorts and registers the images of one camera; may be used from several threads."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        sensor = camera.color if camera.depth is None else camera.depth
        self._color_maps = _undistortion(camera.color)
        self._depth_pixels = _nearest(_undistortion(sensor))
        self._warp = None if camera.depth is None else DepthWarp(camera)

    def color(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Undistorted colour (H, W, 3); pixels from beyond the image repeat its border."""
        if self._color_maps is None:
            return image
        result = cv2.remap(
            image, *self._color_maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(result, np.uint8)

    def depth_m(self, raw: StoredDepth) -> NDArray[np.float32]:
        """Depth (H, W) float32 in metres on the pixels of undistorted colour, 0 where none."""
        from vnav.io.sources.specks import without_specks  # compiled; half a second to import

        if self._depth_pixels is not None:
            raw = cast(StoredDepth, cv2.remap(raw, self._depth_pixels, None, cv2.INTER_NEAREST))
        depth_m = np.divide(raw, self._camera.units_per_metre, dtype=np.float32)
        depth_m[raw == _SATURATED] = 0
        depth_m = without_specks(depth_m)
        return depth_m if self._warp is None else self._warp(depth_m)


class DepthWarp:
    """Moves depth from the depth camera's pixels to those of the undistorted colour camera."""

    def __init__(self, camera: Camera) -> None:
        from vnav.io.sources import warp  # compiled; half a second to import

        self._loops = warp
        self._size = camera.color.size
        assert camera.depth is not None
        columns, rows = np.meshgrid(np.arange(camera.depth.width), np.arange(camera.depth.height))
        pixels = np.stack([columns, rows, np.ones_like(rows)], -1)
        T_color_depth = np.array(camera.T_color_depth)
        K, R, t = camera.color.K, T_color_depth[:3, :3], T_color_depth[:3, 3]
        self._rays = (pixels @ (K @ R @ np.linalg.inv(camera.depth.K)).T).astype(np.float32)
        self._offset = (K @ t).astype(np.float32)
        focal_px = min(camera.depth.fx, camera.depth.fy)
        self._slant = max(warp.LEAST_SLANT, warp.SLANT_PX / focal_px)

    def __call__(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Depth (H, W) float32 seen from the colour camera, metres, 0 where none."""
        width, height = self._size
        inverse_depth = np.zeros((height, width), np.float32)
        uvi = np.empty_like(self._rays)
        self._loops.place(depth_m, self._rays, self._offset, uvi, inverse_depth)
        self._loops.draw(uvi, inverse_depth, self._slant)
        inverse_depth = np.abs(inverse_depth)
        result = np.zeros_like(inverse_depth)
        return np.divide(1, inverse_depth, out=result, where=inverse_depth > 0)


def _undistortion(camera: Intrinsics) -> Maps | None:
    if not camera.distortion:
        return None
    K, distortion = camera.K, np.array(camera.distortion)
    maps = cv2.initUndistortRectifyMap(K, distortion, None, K, camera.size, cv2.CV_32FC1)
    fixed, fraction = cv2.convertMaps(*maps, cv2.CV_16SC2)
    return np.asarray(fixed, np.int16), np.asarray(fraction, np.uint16)


def _nearest(maps: Maps | None) -> NDArray[np.int16] | None:
    """The nearest pixels (H, W, 2) x, y of maps: OpenCV before 4.14 does not round them itself."""
    if maps is None:
        return None
    fixed, fraction = maps  # in 1/32 px, of x below that of y
    steps = np.stack([fraction % 32, fraction // 32], -1)
    return (fixed + (steps >= 16)).astype(np.int16)
