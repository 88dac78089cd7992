"""The whole chain with front-ends whose descriptors are unlike SIFT's bytes."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import vnav
from vnav.config import FeaturesConfig
from vnav.config.registries import FRONT_ENDS
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.frame import Features
from vnav.features.sift import ROOT_SCALE, Sift
from vnav.io.formats.trajectories import read_photo_poses

pytestmark = pytest.mark.slow

ATE_M = 0.02
OFF_M = 0.10  # of a photo: corners known to a pixel or two of 320, seen from a few metres


class Floats:
    """64 floats, made of SIFT's 128 bytes: registered here, and known nowhere else."""

    space = DescriptorSpace("floats", "float32", 64, "l2", 1.0)

    def __init__(self, config: FeaturesConfig) -> None:
        self._sift = Sift(config)

    def extract(self, color: NDArray[np.uint8]) -> Features:
        found = self._sift.extract(color)
        pairs = found.descriptors.reshape(-1, 64, 2).astype(np.float32)
        halved = np.linalg.norm(pairs, axis=2) / np.float32(ROOT_SCALE)
        places = found.keypoints_px, halved, found.scores, found.scales_px, found.angles_rad
        return Features(*places, self.space)


@pytest.fixture(params=["floats", *sorted(FRONT_ENDS.keys() - {"sift"})])
def front_end(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setitem(FRONT_ENDS, "floats", f"{__name__}:Floats")
    return str(request.param)


def test_a_map_is_built_a_photo_located_and_a_path_planned(
    front_end: str, short_capture: Path, tmp_path: Path
) -> None:
    config = vnav.load_config(None, [f"features.front_end={front_end}"])
    made = vnav.build_map(short_capture, tmp_path / "map", config=config)
    off = vnav.score(made.trajectory(), short_capture / "groundtruth.txt")
    assert off.pairs == 36
    assert off.ate.translation_m.rmse < ATE_M

    seen = sorted((short_capture / "photos").glob("*.jpg"))[:2]  # what the others show is not
    answers = list(made.locate_all(seen))
    assert [answer.located for answer in answers] == [True, True]
    truth = read_photo_poses(short_capture / "photos" / "groundtruth.txt")
    for answer in answers:
        wanted = off.ate.T_truth_world @ answer.T_world_camera
        assert np.linalg.norm((wanted - truth[answer.path.name])[:3, 3]) < OFF_M
    assert made.plan(*answers).plan.length_m > 0
