"""Photos of the house are found where they were taken; none of the kitchen is found in it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vnav.core import se3

pytestmark = pytest.mark.real

REJECTS = 40


@pytest.fixture(scope="module")
def answers(house: Any, vnav: Callable[..., Any]) -> dict[str, dict[str, Any]]:
    """What locate says of every photo of the house, by file name."""
    photos = house.capture / "photos"
    said = vnav("locate", photos, "--map", house.map, "--json", expected=(0, 3)).stdout
    return {Path(answer["photo"]).name: answer for answer in json.loads(said)}


def test_photos_of_the_house_are_located(
    house: Any, answers: dict[str, dict[str, Any]], figures: Callable[[str, str, str], None]
) -> None:
    lines = (house.capture / "photos" / "groundtruth.txt").read_text().splitlines()
    rows = [line.split() for line in lines if not line.startswith("#")]
    assert set(answers) == {row[0] for row in rows}
    right, wrong = [], []
    for name, *numbers in rows:
        if not answers[name]["located"]:
            continue
        position, quat_xyzw = np.array(numbers[:3], float), np.array(numbers[3:], float)
        T_truth_camera = house.T_truth_world @ np.array(answers[name]["T_world_camera"])
        error_m = np.linalg.norm(T_truth_camera[:3, 3] - position)
        true = se3.make(se3.rotation_from_quat(quat_xyzw), position)
        error_deg = np.rad2deg(se3.rotation_angle(se3.inverse(true) @ T_truth_camera))
        if error_m <= 0.05 and error_deg <= 2:
            right.append((error_m, error_deg))
        if error_m > 0.30 or error_deg > 10:
            wrong.append((name, float(error_m), float(error_deg)))
    medians = np.median(right, axis=0) if right else (np.nan, np.nan)
    precise = f"median {100 * medians[0]:.1f} cm, {medians[1]:.2f} deg"
    seconds = np.median([sum(answer["seconds"].values()) for answer in answers.values()])
    figures("house photos within 5 cm and 2 deg", f"{len(right)} ({precise})", "37 of 40")
    figures("house photos wrong by over 30 cm or 10 deg", str(len(wrong)), "none")
    figures("house photos: median time", f"{seconds:.2f} s", "")
    assert len(right) >= 37
    assert not wrong


def test_photos_of_the_kitchen_are_not_found_in_the_house(
    house: Any, captures: Path, vnav: Callable[..., Any], figures: Callable[[str, str, str], None]
) -> None:
    kitchen = captures / "redkitchen01"
    photos = sorted((kitchen / "rgb").iterdir())
    photos = [photos[i] for i in np.linspace(0, len(photos) - 1, REJECTS).astype(int)]
    options = "--map", house.map, "--camera", kitchen / "camera.toml", "--json"
    said = vnav("locate", *photos, *options, expected=(0, 3))
    found = [answer["photo"] for answer in json.loads(said.stdout) if answer["located"]]
    figures("kitchen photos located in the house", f"{len(found)} of {len(photos)}", "none")
    assert not found
    assert said.returncode == 3
