"""How the first image of a feature looks from where the camera is now: [000 section 2]."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.tracking.correlation import TEMPLATE_PX
from vnav.tracking.patch_alignment import affine_warp, sample

REACH_PX = 15  # of the image that is kept around a feature


@dataclass(frozen=True)
class Template:
    """The image around a feature when it was seen first.

    ``patch`` (31, 31) grey levels around the pixel ``px`` (2,); ``ray``: its distance where its z
    is 1; ``slopes`` (2,) of the surface's inverse z along x and y, 1/m a pixel; ``T_world_anchor``
    of the camera then.
    """

    patch: Array
    px: Array
    ray: float
    slopes: Array
    T_world_anchor: Array

    def warped(self, T_world_camera: Array, inverse_depth: float, camera: Intrinsics) -> Array:
        """As a camera sees it (11, 11); NaN where more of the image would be needed.

        ``inverse_depth``: of its distance from the first camera, 1/m.
        """
        T_camera_anchor = se3.inverse(T_world_camera) @ self.T_world_anchor
        surface = np.append(inverse_depth * self.ray, self.slopes)
        A = affine_warp(T_camera_anchor, self.px[None], surface[None], camera)[0]
        return np.asarray(_warped(self.patch, A))


def cut(image: NDArray[np.uint8], px: Array) -> Array:
    """The patch (31, 31) around a whole pixel (2,) that is at least 15 px from the image's edge."""
    u, v = (int(x) for x in px)
    return image[v - REACH_PX : v + REACH_PX + 1, u - REACH_PX : u + REACH_PX + 1].astype(
        np.float64
    )


@compiled
def _warped(patch: Array, A: Array) -> Array:
    template = np.full((TEMPLATE_PX, TEMPLATE_PX), np.nan)
    if np.isfinite(A).all() and abs(np.linalg.det(A)) > 1e-3:
        middle = np.full(2, REACH_PX * 1.0)
        inverse = np.asarray(np.linalg.inv(A))
        if not sample(template, patch, middle, inverse):
            template[:] = np.nan
    return template
