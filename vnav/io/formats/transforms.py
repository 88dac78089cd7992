"""transforms.json of NeRF, instant-ngp and Nerfstudio: docs.nerf.studio, data conventions.

A camera looks along its -z axis there, and y is up, as in OpenGL. The world is ours, z up. The
centre of the upper left pixel is (0.5, 0.5) there, and (0, 0) here.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from vnav.core.camera import Intrinsics
from vnav.core.posed_images import CORNER_PX, PosedImages
from vnav.io.files import write_text

T_OPENCV_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # turns y and z over
DEPTH_UNITS_PER_METRE = 1000  # what Nerfstudio takes depth images for, unless it is told


def write_transforms(path: Path, views: PosedImages, colors: str, depths: str, cloud: str) -> None:
    """Write pose and camera of each image; ``colors``, ``depths``: folders, ``cloud``: a file.

    These are beside ``path``. One camera stands at the top, several stand with their images.
    """
    lenses = [_lens(camera) for camera in views.cameras]
    is_one = all(lens == lenses[0] for lens in lenses)
    frames = [
        {
            "file_path": f"{colors}/{image.name}.jpg",
            "depth_file_path": f"{depths}/{image.name}.png",
            "transform_matrix": (image.T_world_camera @ T_OPENCV_OPENGL).tolist(),
            **({} if is_one else lenses[image.camera]),
        }
        for image in views.images
    ]
    top = {
        "camera_model": "OPENCV",
        **(lenses[0] if is_one else {}),
        "integer_depth_scale": 1 / DEPTH_UNITS_PER_METRE,
        "ply_file_path": cloud,
    }
    write_text(path, json.dumps({**top, "frames": frames}, indent=1) + "\n")


def _lens(camera: Intrinsics) -> dict[str, Any]:
    """Its keys; the images are undistorted."""
    return {
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx + CORNER_PX,
        "cy": camera.cy + CORNER_PX,
        **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0),
    }
