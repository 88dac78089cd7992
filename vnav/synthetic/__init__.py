"""A procedural apartment rendered to RGB-D with exact truth: for the demo and the tests."""

from vnav.synthetic.rendered_capture import (
    DEMO,
    HANDHELD,
    MINIATURE,
    CaptureSpec,
    cached_capture,
    write_capture,
)
from vnav.synthetic.scene import Box, Scene
from vnav.synthetic.scenes import SCENES, apartment, one_room
from vnav.synthetic.sensor import Sensor

__all__ = [
    "DEMO",
    "HANDHELD",
    "MINIATURE",
    "SCENES",
    "Box",
    "CaptureSpec",
    "Scene",
    "Sensor",
    "apartment",
    "cached_capture",
    "one_room",
    "write_capture",
]
