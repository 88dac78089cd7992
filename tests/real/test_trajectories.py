"""Every frame of the real captures tracked, and how true the trajectories are."""

import json
from collections.abc import Callable

import pytest

pytestmark = pytest.mark.real


@pytest.mark.parametrize(
    ("name", "limit_m"),
    [("house", 0.015), ("redkitchen", 0.055), ("desk", 0.0178)],  # others reach 0.016 to 0.029
    ids=["house", "redkitchen", "desk"],
)
def test_every_frame_is_tracked_and_the_trajectory_is_true(
    name: str,
    limit_m: float,
    request: pytest.FixtureRequest,
    vnav: Callable[..., object],
    figures: Callable[[str, str, str], None],
) -> None:
    built = request.getfixturevalue(name)
    trajectory = built.map / "optimise" / "trajectory_0.tum"
    listed = (built.capture / "rgb.txt").read_text().splitlines()
    frames = len([line for line in listed if not line.startswith("#")])
    posed = len([x for x in trajectory.read_text().splitlines() if not x.startswith("#")])
    scored = vnav("score", trajectory, built.capture / "groundtruth.txt", "--json")
    score = json.loads(scored.stdout)
    figures(f"{name}: frames tracked", f"{posed} of {frames}", "all")
    figures(f"{name}: ATE RMSE", f"{score['ate_m']['rmse']:.4f} m", f"{limit_m} m")
    assert posed == frames
    assert score["pairs"] == frames
    assert score["ate_m"]["rmse"] <= limit_m
