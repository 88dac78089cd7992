"""What the stages before have made of the tiny capture."""

from pathlib import Path

import pytest

from vnav.core.camera import Intrinsics
from vnav.core.mapping import Odometry
from vnav.io.artifacts import load_odometry, map_camera
from vnav.io.map_folder import MapFolder


@pytest.fixture(scope="module")
def folder(tiny_map: Path) -> MapFolder:
    return MapFolder(tiny_map)


@pytest.fixture(scope="module")
def odometry(folder: MapFolder) -> Odometry:
    return load_odometry(folder)


@pytest.fixture(scope="module")
def camera(folder: MapFolder) -> Intrinsics:
    return map_camera(folder)
