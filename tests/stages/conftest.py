"""What the stages before have made of the tiny capture."""

from pathlib import Path

import pytest

from vnav.config import CaptureConfig, RegistrationConfig
from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame
from vnav.core.mapping import Odometry
from vnav.features.matching import DescriptorMatcher
from vnav.io.artifacts import load_odometry, map_camera
from vnav.io.capture import open_capture
from vnav.io.map_folder import MapFolder
from vnav.registration import Sensor


@pytest.fixture(scope="module")
def folder(tiny_map: Path) -> MapFolder:
    return MapFolder(tiny_map)


@pytest.fixture(scope="module")
def odometry(folder: MapFolder) -> Odometry:
    return load_odometry(folder)


@pytest.fixture(scope="module")
def camera(folder: MapFolder) -> Intrinsics:
    return map_camera(folder)


@pytest.fixture(scope="module")
def frames(tiny_capture: Path) -> list[Frame]:
    """The first six."""
    capture = open_capture(tiny_capture, CaptureConfig())
    return [capture.read(k) for k in range(6)]


@pytest.fixture(scope="module")
def sensor(camera: Intrinsics) -> Sensor:
    config = RegistrationConfig()
    return Sensor(camera, config, DescriptorMatcher(config))
