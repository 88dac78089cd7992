"""The first half of the kitchen mapped at its true poses; the second half's frames are found."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vnav.core import se3
from vnav.io.formats.trajectories import read_tum

pytestmark = [pytest.mark.real, pytest.mark.long]  # a second build of the kitchen

HALF, EVERY = 500, 10


@pytest.fixture(scope="module")
def answers(
    captures: Path,
    part_of: Callable[..., Path],
    vnav: Callable[..., Any],
    tmp_path_factory: pytest.TempPathFactory,
) -> list[dict[str, Any]]:
    """What locate says of every tenth frame of the second half."""
    kitchen, folder = captures / "redkitchen01", part_of("redkitchen01", 0, HALF)
    map_dir = tmp_path_factory.mktemp("maps") / "half"
    poses = kitchen / "groundtruth.txt"
    vnav("build-map", folder, "--map", map_dir, "--trajectory", poses)
    photos = sorted((kitchen / "rgb").iterdir(), key=lambda p: float(p.stem))[HALF::EVERY]
    options = "--map", map_dir, "--camera", kitchen / "camera.toml", "--json"
    found: list[dict[str, Any]] = json.loads(
        vnav("locate", *photos, *options, expected=(0, 3)).stdout
    )
    return found


def test_frames_of_the_second_half_are_located_in_the_first(
    captures: Path, answers: list[dict[str, Any]], figures: Callable[[str, str, str], None]
) -> None:
    truth = read_tum(captures / "redkitchen01" / "groundtruth.txt")
    errors = []
    for answer in answers:
        if answer["located"]:
            nearest = np.abs(truth.stamps_s - float(Path(answer["photo"]).stem)).argmin()
            error = se3.inverse(truth.T_world_camera[nearest]) @ answer["T_world_camera"]
            degrees = np.rad2deg(se3.rotation_angle(error))
            errors.append((np.linalg.norm(error[:3, 3]), degrees))
    off_m, off_deg = np.array(errors).reshape(-1, 2).T
    share = {m: ((off_m <= m) & (off_deg <= 5)).sum() / len(answers) for m in (0.05, 0.10)}
    wrong = int(((off_m > 0.30) | (off_deg > 10)).sum())
    figures("kitchen halves, true poses: within 5 cm and 5 deg", f"{share[0.05]:.0%}", "52 %")
    figures("kitchen halves, true poses: within 10 cm and 5 deg", f"{share[0.10]:.0%}", "96 %")
    figures("kitchen halves, true poses: wrong", str(wrong), "0")
    assert wrong == 0
    assert share[0.05] >= 0.52
    assert share[0.10] >= 0.96
