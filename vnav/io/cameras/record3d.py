"""Record3D's metadata: ``K`` column by column, ``w``, ``h``, and the camera of each frame.

``perFrameIntrinsicCoeffs`` (fx, fy, cx, cy of each frame) follows the autofocus. The matrix is
ARKit's, whose origin is the corner of the image. Depth is stored in metres there, but not as 16-bit
images: their units are whose converted it.

Source: https://record3d.app and its export; ARCamera.intrinsics of ARKit.
"""

from typing import Any

from vnav.io.cameras.tables import Tables, from_corner, pinhole

NAME = "Record3D"
FILES: tuple[str, ...] = ("metadata.json", "metadata")


def recognises(content: Any) -> bool:
    """Whether it has a matrix and a size under Record3D's names."""
    return isinstance(content, dict) and {"K", "w", "h"} <= content.keys()


def tables(content: Any) -> Tables:
    """The colour camera; ValueError where it changes from frame to frame."""
    each = content.get("perFrameIntrinsicCoeffs") or []
    if any(one != each[0] for one in each):
        raise ValueError(
            "expected one camera for all frames, found perFrameIntrinsicCoeffs that differ; record"
            " with the focus locked"
        )
    size = {"width": content["w"], "height": content["h"]}
    return {"color": size | from_corner(pinhole(content["K"], by_columns=True))}
