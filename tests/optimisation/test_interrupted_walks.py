"""Walks past what repeats itself, without the frames of some seconds: not bent without a word."""

from pathlib import Path

import numpy as np
import pytest

from tests.tracking.stretches import STEP_M, stretch
from vnav.config import Config
from vnav.core.trajectory import Trajectory
from vnav.evaluation.score import score
from vnav.io.store.artifacts import load_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.pipeline.build import run_stages
from vnav.pipeline.quality import assess
from vnav.stages import odometry
from vnav.synthetic import SCENES
from vnav.synthetic.path import frames_at

pytestmark = pytest.mark.slow

MOST_M = 0.03  # ATE, by a small camera; the shortest period of what repeats is 0.08 m
LOST, MOST_S = 31, 0.01  # frames of a tenth of a second; between stamps


@pytest.mark.parametrize("scene", ["library", "supermarket", "shop"])
@pytest.mark.parametrize(("first", "end"), [(0.3, 1.0), (0.6, 1.0), (0.3, 0.6)])
def test_a_walk_past_what_repeats_is_right_after_an_interruption_or_cut_or_called_doubtful(
    scene: str, first: float, end: float, tmp_path: Path
) -> None:
    frames = frames_at(STEP_M, SCENES[scene](0).tour)
    lost = round(first * frames)
    rows = [*range(lost), *range(lost + LOST, round(end * frames))]
    capture, T_world_camera = stretch(scene, 0, rows)
    folder, config = MapFolder.create(tmp_path / "map"), Config()
    odometry.run(folder, capture, config)
    run_stages(folder, ("vocabulary", "loops", "optimise"), config)
    if assess(folder, config).values["places_unsure"]:
        return
    poses, stamps_s = load_optimised(folder).T_world_camera, np.asarray(capture.stamps_s)
    posed = np.isfinite(poses[:, 0, 0])
    assert posed.sum() >= lost / 2
    found, true = Trajectory(stamps_s[posed], poses[posed]), Trajectory(stamps_s, T_world_camera)
    assert score(found, true, MOST_S).ate.translation_m.rmse < MOST_M
