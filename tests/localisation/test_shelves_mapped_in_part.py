"""Photos of shelves that look the same, of which the map has all or a part."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vnav
from tests.tracking.stretches import STEP_M, stretch
from vnav.config import Config
from vnav.core.trajectory import Trajectory
from vnav.io.formats.trajectories import read_photo_poses, read_tum
from vnav.io.sources.open_capture import open_capture
from vnav.io.store.map_folder import MapFolder
from vnav.pipeline.build import build_map
from vnav.synthetic import MINIATURE, SCENES, cached_capture
from vnav.synthetic.path import frames_at

pytestmark = pytest.mark.slow

MAPPED = 0.4  # of the walk
SAME_PLACE_M = 0.25
EVERY = 6
SEED, PHOTOS = 1, 20
FOUND = 0.9  # of the photos at least


@pytest.mark.parametrize("seed", [1, 3])
def test_a_photo_of_the_shelves_that_nobody_mapped_is_not_placed_at_those_that_are(
    seed: int, tmp_path: Path
) -> None:
    frames = frames_at(STEP_M, SCENES["library"](seed).tour)
    capture, T_mapped = stretch("library", seed, range(round((1 - MAPPED) * frames), frames))
    given = Trajectory(np.asarray(capture.stamps_s), T_mapped)
    build_map(MapFolder.create(tmp_path / "map"), capture, Config(), given=given)
    photos, T_true = stretch("library", seed, range(0, frames, EVERY))
    found = vnav.open_map(tmp_path / "map")
    answers = [
        found.locate(photos.read(k).color, camera=MINIATURE.camera) for k in range(len(photos))
    ]
    off_m = [
        float(np.linalg.norm(a.T_world_camera[:3, 3] - T[:3, 3]))
        for a, T in zip(answers, T_true, strict=True)
        if a.T_world_camera is not None
    ]
    assert off_m
    assert max(off_m) < SAME_PLACE_M


@pytest.mark.parametrize("scene", ["library", "supermarket"])
def test_a_photo_is_placed_by_what_is_unlike_in_a_twentieth_of_it(
    scene: str, tmp_path: Path
) -> None:
    """The features of what repeats itself match in every place that has it."""
    frames = frames_at(STEP_M, SCENES[scene](SEED).tour)
    spec = replace(MINIATURE, scene=scene, seed=SEED, frames=frames, photos=PHOTOS, name=scene)
    folder = cached_capture(spec)
    given = read_tum(folder / "groundtruth.txt")
    capture = open_capture(folder, Config().capture)
    build_map(MapFolder.create(tmp_path / "map"), capture, Config(), given=given)
    found = vnav.open_map(tmp_path / "map")
    off_m = []
    for name, T in read_photo_poses(folder / "photos" / "groundtruth.txt").items():
        answer = found.locate(folder / "photos" / name)
        if answer.T_world_camera is not None:
            off_m.append(float(np.linalg.norm(answer.T_world_camera[:3, 3] - T[:3, 3])))
    assert len(off_m) >= FOUND * PHOTOS
    assert max(off_m) < SAME_PLACE_M
