"""Clouds as LAS 1.2, which surveyors' tools read: ASPRS, by laspy, which is optional."""

from pathlib import Path

import numpy as np

from vnav.core.point_cloud import PointCloud
from vnav.errors import MapError
from vnav.io.files import whole_file

SCALE_M = 1e-4  # of the whole numbers that positions are kept in
FULL_SCALE = 257  # 16 bits from 8: 255 becomes 65535


def require_laspy() -> None:
    """MapError where laspy is not installed."""
    try:
        import laspy  # noqa: F401
    except ImportError as error:
        raise MapError(
            "expected laspy to write LAS, found it not installed; run"
            " 'pip install vnav-rgbd[export]', or export the cloud as PLY"
        ) from error


def write_las(path: Path, cloud: PointCloud) -> None:
    """Write positions to 0.1 mm and colours of 16 bits; `require_laspy` first."""
    import laspy

    header = laspy.LasHeader(version="1.2", point_format=2)
    header.scales, header.offsets = np.full(3, SCALE_M), np.zeros(3)
    las = laspy.LasData(header)
    las.xyz = cloud.points_world.astype(float)
    las.red, las.green, las.blue = cloud.colors.T.astype(np.uint16) * FULL_SCALE
    with whole_file(path) as file:
        las.write(file)
