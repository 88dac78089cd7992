"""vnav: from a folder of RGB-D frames to a map, a located photo and a planned path.

Everything here is loaded when it is first used; docs/api.md shows it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from vnav.errors import (
    CameraError,
    CaptureError,
    ConfigError,
    DatasetError,
    MapError,
    PhotoError,
    StaleArtifact,
    TrajectoryError,
    VnavError,
)

if TYPE_CHECKING:
    from vnav.api.building import build_map, extend_map, open_capture
    from vnav.api.calibrating import calibrate
    from vnav.api.importing import import_capture
    from vnav.api.judging import check, compare_trackers, evaluate, score
    from vnav.api.map import Map, open_map
    from vnav.calibration.board import Board
    from vnav.calibration.images import Calibration
    from vnav.config import Config
    from vnav.config import load as load_config
    from vnav.core.camera import Camera, Intrinsics
    from vnav.core.trajectory import Trajectory
    from vnav.io.photos.arriving import arriving_photos
    from vnav.io.recordings.importing import ImportedCapture
    from vnav.io.sources.capture import Capture
    from vnav.io.sources.memory import frames
    from vnav.localisation.verdict.answer import PhotoAnswer, UnreadablePhoto
    from vnav.stages.plan import PlanAnswer

__version__ = "0.1.0"
__all__ = [
    "Board",
    "Calibration",
    "Camera",
    "CameraError",
    "Capture",
    "CaptureError",
    "Config",
    "ConfigError",
    "DatasetError",
    "ImportedCapture",
    "Intrinsics",
    "Map",
    "MapError",
    "PhotoAnswer",
    "PhotoError",
    "PlanAnswer",
    "StaleArtifact",
    "Trajectory",
    "TrajectoryError",
    "UnreadablePhoto",
    "VnavError",
    "arriving_photos",
    "build_map",
    "calibrate",
    "check",
    "compare_trackers",
    "evaluate",
    "extend_map",
    "frames",
    "import_capture",
    "load_config",
    "open_capture",
    "open_map",
    "score",
]

_PLACES = {
    "Board": "vnav.calibration.board:Board",
    "Calibration": "vnav.calibration.images:Calibration",
    "Camera": "vnav.core.camera:Camera",
    "Capture": "vnav.io.sources.capture:Capture",
    "Config": "vnav.config:Config",
    "ImportedCapture": "vnav.io.recordings.importing:ImportedCapture",
    "Intrinsics": "vnav.core.camera:Intrinsics",
    "Map": "vnav.api.map:Map",
    "PhotoAnswer": "vnav.localisation.verdict.answer:PhotoAnswer",
    "PlanAnswer": "vnav.stages.plan:PlanAnswer",
    "Trajectory": "vnav.core.trajectory:Trajectory",
    "UnreadablePhoto": "vnav.localisation.verdict.answer:UnreadablePhoto",
    "arriving_photos": "vnav.io.photos.arriving:arriving_photos",
    "build_map": "vnav.api.building:build_map",
    "calibrate": "vnav.api.calibrating:calibrate",
    "check": "vnav.api.judging:check",
    "compare_trackers": "vnav.api.judging:compare_trackers",
    "evaluate": "vnav.api.judging:evaluate",
    "extend_map": "vnav.api.building:extend_map",
    "frames": "vnav.io.sources.memory:frames",
    "import_capture": "vnav.api.importing:import_capture",
    "load_config": "vnav.config:load",
    "open_capture": "vnav.api.building:open_capture",
    "open_map": "vnav.api.map:open_map",
    "score": "vnav.api.judging:score",
}


def __getattr__(name: str) -> Any:
    """Load what is asked for; AttributeError where there is nothing of that name."""
    if name not in _PLACES:
        raise AttributeError(f"module 'vnav' has no attribute '{name}'")
    module, _, original = _PLACES[name].partition(":")
    value = globals()[name] = getattr(import_module(module), original)
    return value


def __dir__() -> list[str]:
    """What there is, loaded or not."""
    return sorted({*globals(), *__all__})
