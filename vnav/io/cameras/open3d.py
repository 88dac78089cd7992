"""Open3D's recorders and readers: RealSense and Azure Kinect.

Three writers share one layout, ``width``, ``height`` and ``intrinsic_matrix`` column by column:
PinholeCameraIntrinsic (camera_intrinsic.json of realsense_recorder.py), MKVMetadata (intrinsic.json
of the Azure Kinect reader) and RGBDVideoMetadata (intrinsic.json of RSBagReader), which adds
``depth_scale`` in units a metre. Depth is aligned to colour by all of them.

Source: Open3D's ConvertToJsonValue of these classes, and examples/python/reconstruction_system.
"""

from typing import Any

from vnav.io.cameras.tables import Tables, pinhole

NAME = "Open3D"
FILES: tuple[str, ...] = ("camera_intrinsic.json", "intrinsic.json")

_UNITS_PER_METRE = 1000.0  # what its recorders store, where the file does not tell


def recognises(content: Any) -> bool:
    """Whether it has the calibration matrix under Open3D's name."""
    return isinstance(content, dict) and "intrinsic_matrix" in content


def tables(content: Any) -> Tables:
    """The colour camera, and the units of depth that is registered to it."""
    size = {key: content[key] for key in ("width", "height") if key in content}
    return {
        "color": size | pinhole(content["intrinsic_matrix"], by_columns=True),
        "depth": {"units_per_metre": content.get("depth_scale", _UNITS_PER_METRE)},
    }
