"""The verdict on a map."""

import dataclasses
import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest

from vnav.config import Config, FeaturesConfig
from vnav.core.frame import Edge
from vnav.core.mapping import CONTRADICTS
from vnav.io.store.artifacts import (
    load_loop_edges,
    load_loops,
    load_mended_edges,
    load_odometry,
    load_optimised,
    load_whole_keyframe,
    save_keyframe_mask,
    save_loops,
    save_mended_edges,
    save_odometry,
    save_optimised,
    save_verdicts,
)
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.overview import has_verdict, overview
from vnav.optimisation.mending import CUT, TAKEN, Mend
from vnav.pipeline.build import judged
from vnav.pipeline.quality import agreement, are_joined, assess
from vnav.registration.reduction import reduced
from vnav.stages import optimise

Altering = Callable[[MapFolder, str], AbstractContextManager[Path]]
CONFIG = Config(features=FeaturesConfig(max_features=700))  # that of the map that is copied


@pytest.fixture
def folder(whole_map: Path, tmp_path: Path) -> MapFolder:
    shutil.copytree(whole_map, tmp_path / "map")
    return MapFolder(tmp_path / "map")


def test_a_map_that_agrees_with_itself_is_good(folder: MapFolder) -> None:
    quality = assess(folder, CONFIG)
    assert quality.doubts == ()
    revisits, loops = quality.values["revisits"], quality.values["loops"]
    assert quality.line.startswith(f"good: no fault in {revisits} revisits, {loops} loops, ")
    assert revisits > 5  # the walk ends where it began


def test_a_verdict_names_only_what_was_there_to_be_counted(folder: MapFolder) -> None:
    odometry = load_odometry(folder)
    steps, motions = len(odometry.keyframes) - 1, len(odometry.frames) - 1
    assert agreement(0, 0, odometry, len(odometry.frames)) == (
        f"no fault in {steps} steps, {motions} motions;"
        " no place was seen twice, so drift was not checked"
    )
    alone = dataclasses.replace(odometry, keyframes=odometry.keyframes[:1], edges=())
    told = agreement(0, 0, alone, len(odometry.frames))
    assert told.startswith("no fault in a single frame; no place")


def test_a_good_map_of_some_of_the_frames_says_so(folder: MapFolder, altering: Altering) -> None:
    of = len(load_odometry(folder).frames)
    leave_out(folder, altering, slice(of // 2))
    quality = assess(folder, CONFIG)
    assert quality.line.endswith(f"; only {of - of // 2} of {of} frames are in it")


def leave_out(folder: MapFolder, altering: Altering, rows: slice) -> None:
    """Some of the frames have no pose in the map."""
    result = load_optimised(folder)
    poses = result.T_world_camera.copy()
    poses[rows] = np.nan
    with altering(folder, "optimise") as draft:
        save_optimised(draft, dataclasses.replace(result, T_world_camera=poses))


def test_edges_between_neighbours_are_no_loops(folder: MapFolder, altering: Altering) -> None:
    near = [v for v in load_loops(folder) if v.accepted and not v.is_loop]
    assert near
    with altering(folder, "optimise") as draft:
        save_verdicts(draft, near)
    with altering(folder, "loops") as draft:
        save_loops(draft, near, load_loop_edges(folder)[0][: len(near)], np.zeros((0, 4), np.int32))
    assert assess(folder, CONFIG).values["loops"] == 0


def move_aside(folder: MapFolder, altering: Altering, rows: slice, metres: float = 0.3) -> None:
    """Some of the map's frames are moved aside, in x and in y."""
    result = load_optimised(folder)
    poses = result.T_world_camera.copy()
    poses[rows, :2, 3] += metres
    with altering(folder, "optimise") as draft:
        save_optimised(draft, dataclasses.replace(result, T_world_camera=poses))


def slip(folder: MapFolder, altering: Altering) -> None:
    """The second half of the map's frames is moved aside."""
    move_aside(folder, altering, slice(len(load_odometry(folder).frames) // 2, None))


def turn_down(folder: MapFolder, altering: Altering, share: float) -> None:
    """Mark a share of the accepted loops as if the pose graph had turned them down."""
    verdicts = list(load_loops(folder))
    accepted = [n for n, v in enumerate(verdicts) if v.accepted]
    for n in accepted[: round(share * len(accepted))]:
        verdicts[n] = dataclasses.replace(verdicts[n], accepted=False, reason=CONTRADICTS)
    with altering(folder, "optimise") as draft:
        save_verdicts(draft, verdicts)


def test_a_map_whose_second_half_has_slipped_is_doubtful(
    folder: MapFolder, altering: Altering
) -> None:
    slip(folder, altering)

    quality = assess(folder, CONFIG)

    assert quality.values["verdict"] == "doubtful"
    assert "see one place again disagree" in quality.doubts[0]


def test_a_map_that_turned_down_loops_which_fit_the_images_is_doubtful(
    folder: MapFolder, altering: Altering
) -> None:
    slip(folder, altering)
    turn_down(folder, altering, 1.0)

    doubts = assess(folder, CONFIG).doubts

    assert any("loops contradict the map and fit the images better" in doubt for doubt in doubts)


def test_loops_turned_down_that_fit_the_images_no_better_are_no_doubt(
    folder: MapFolder, altering: Altering
) -> None:
    turn_down(folder, altering, 0.9)  # they say what the map says

    quality = assess(folder, CONFIG)

    assert quality.doubts == ()
    assert quality.values["loops_rejected"] > 5
    assert quality.values["loops_contradicting"] == 0


def step_aside(folder: MapFolder, altering: Altering) -> None:
    """The last keyframe is moved aside."""
    last = load_odometry(folder).keyframe_rows[-1]
    move_aside(folder, altering, slice(last, last + 1))


def test_a_step_that_does_not_fit_the_images_makes_a_map_doubtful(
    folder: MapFolder, altering: Altering
) -> None:
    step_aside(folder, altering)

    doubts, rows = assess(folder, CONFIG).doubts, load_odometry(folder).keyframe_rows

    of = f"1 of {len(rows) - 1} steps from keyframe to keyframe do not fit the images"
    where = f"within frames {rows[-2]} to {rows[-1]};"
    assert any(f"{of}, {where}" in doubt for doubt in doubts)
    assert all("record" in doubt for doubt in doubts)


def test_keyframes_that_the_optimisation_took_apart_make_no_step(
    folder: MapFolder, altering: Altering
) -> None:
    step_aside(folder, altering)
    last = load_odometry(folder).keyframe_rows[-1]
    with altering(folder, "optimise") as draft:
        save_mended_edges(draft, [e for e in load_mended_edges(folder) if last not in (e.i, e.j)])

    assert assess(folder, CONFIG).values["steps_unborne"] == 0


def test_a_place_that_was_found_again_though_others_look_like_it_makes_a_map_doubtful(
    folder: MapFolder,
) -> None:
    report = folder.report("optimise")
    report["values"]["mended"] = [vars(Mend(7, 9, TAKEN)), vars(Mend(12, 12, CUT))]
    folder.write_report("optimise", report)

    (doubt,) = assess(folder, CONFIG).doubts

    assert "1 time, after an interruption or in another recording, the camera may be" in doubt
    assert "within frames 7 to 9;" in doubt


def test_a_map_most_of_whose_views_is_masked_and_stands_is_doubtful(
    folder: MapFolder, altering: Altering
) -> None:
    odometry = load_odometry(folder)
    rows = odometry.keyframe_rows[3:9].tolist()
    with altering(folder, "odometry") as draft:
        for row in rows:
            image = reduced(load_whole_keyframe(folder, row, odometry.frames))
            moving = np.ones(image.grey.shape, bool)
            moving[: len(moving) // 3] = False
            save_keyframe_mask(draft, row, moving)

    quality = assess(folder, CONFIG)

    assert quality.values["steps_standing"] == len(rows)
    where = f"within frames {odometry.keyframe_rows[2]} to {rows[-1]};"
    assert any("most of the view is taken for moving" in d and where in d for d in quality.doubts)


def test_a_motion_that_is_faster_than_a_camera_is_carried_makes_a_map_doubtful(
    folder: MapFolder, altering: Altering
) -> None:
    row = load_odometry(folder).keyframe_rows[-1]
    move_aside(folder, altering, slice(row, None), 3.0)

    quality = assess(folder, CONFIG)

    assert quality.values["jumps"] == 1
    assert any(f"carried, within frames {row - 1} to {row};" in doubt for doubt in quality.doubts)


def test_doubts_about_given_poses_say_how_to_adjust_them(
    folder: MapFolder, altering: Altering
) -> None:
    step_aside(folder, altering)
    with altering(folder, "odometry") as draft:
        save_odometry(draft, dataclasses.replace(load_odometry(folder), given=True))

    doubts = assess(folder, CONFIG).doubts

    assert doubts
    assert all("--set optimise.given_poses=prior" in doubt for doubt in doubts)
    assert not any("record" in doubt for doubt in doubts)


def doubt_motions(folder: MapFolder, altering: Altering, rows: set[int]) -> None:
    """Make all edges into some frames unlikely."""
    odometry = load_odometry(folder)
    edges = tuple(
        dataclasses.replace(e, probability=0.3) if e.j in rows else e for e in odometry.edges
    )
    with altering(folder, "odometry") as draft:
        save_odometry(draft, dataclasses.replace(odometry, edges=edges))


def test_frames_none_of_whose_motions_is_likely_are_named(
    folder: MapFolder, altering: Altering
) -> None:
    doubt_motions(folder, altering, {7, 9})

    (doubt,) = assess(folder, CONFIG).doubts

    assert "the motion of 2 frames is in doubt, within frames 7 to 9;" in doubt


def test_one_such_frame_alone_is_no_doubt(folder: MapFolder, altering: Altering) -> None:
    doubt_motions(folder, altering, {7})

    quality = assess(folder, CONFIG)

    assert quality.doubts == ()
    assert quality.values["motions_unsure"] == 1


def test_motions_of_frames_that_are_not_in_the_map_are_no_doubt(
    folder: MapFolder, altering: Altering
) -> None:
    doubt_motions(folder, altering, {7, 9})
    leave_out(folder, altering, slice(10))

    assert assess(folder, CONFIG).values["motions_unsure"] == 0


def test_loops_join_all_parts_between_unlikely_motions_or_leave_one_out() -> None:
    unlikely, step = np.array([20, 40]), np.eye(6)
    round_trip, to_the_middle = (Edge(i, j, np.eye(4), step) for i, j in ((0, 50), (5, 20)))
    assert not are_joined(unlikely, [])
    assert not are_joined(unlikely, [round_trip])
    assert are_joined(unlikely, [round_trip, to_the_middle])


def test_where_loops_join_all_parts_unlikely_motions_are_no_doubt(
    folder: MapFolder, altering: Altering
) -> None:
    # Loops from the frames before to the first frame of each part.
    edges, _ = load_loop_edges(folder)
    verdicts = [v for v in load_loops(folder) if v.accepted or v.reason == CONTRADICTS]
    loops = [e for e, v in zip(edges, verdicts, strict=True) if v.accepted and v.is_loop]
    begin, then = sorted({e.j for e in loops})[:2]
    assert all(min(e.i for e in loops if e.j == j) < begin for j in (begin, then))
    doubt_motions(folder, altering, {begin, then})

    quality = assess(folder, CONFIG)

    assert quality.doubts == ()
    assert quality.values["motions_unsure"] == 2


def test_one_likely_motion_is_enough_for_a_frame(folder: MapFolder, altering: Altering) -> None:
    odometry = load_odometry(folder)
    edges = list(odometry.edges)
    into = [e.j for e in edges]
    for first in {into.index(j) for j in into if into.count(j) > 1}:
        edges[first] = dataclasses.replace(edges[first], probability=0.1)
    with altering(folder, "odometry") as draft:
        save_odometry(draft, dataclasses.replace(odometry, edges=tuple(edges)))

    assert assess(folder, CONFIG).values["motions_unsure"] == 0


GIVEN = 525.0, 320.0, 240.0, 0.0


def say_camera(
    folder: MapFolder, fitted_px: tuple[float, ...], sigma_px: float, k1: float = 0.0
) -> None:
    """Let the report of optimise say what camera was given, and which one the images fit."""
    report = folder.report("optimise")
    fit = {"given": GIVEN, "fitted": [*fitted_px, k1], "sigma": [*[sigma_px] * 3, 0.001]}
    fit["corner"] = 400 / GIVEN[0]
    report["values"]["camera_fits"] = [fit]
    folder.write_report("optimise", report)


def test_images_that_fit_another_focal_length_are_told_of(folder: MapFolder) -> None:
    say_camera(folder, (500.0, 325.0, 240.0), 1.0)

    (doubt,) = assess(folder, CONFIG).doubts

    assert "a focal length of 500.0 px (+- 1.0) where 525.0 px were given" in doubt
    assert "cx" not in doubt


def test_images_that_fit_another_principal_point_are_told_of(folder: MapFolder) -> None:
    say_camera(folder, (520.0, 300.0, 258.0), 1.0)

    (doubt,) = assess(folder, CONFIG).doubts

    assert "cx of 300.0 px (+- 1.0) where 320.0 px were given" in doubt
    assert "cy of 258.0 px (+- 1.0) where 240.0 px were given" in doubt
    assert "focal" not in doubt


def test_a_distortion_that_was_left_out_is_told_of(folder: MapFolder) -> None:
    say_camera(folder, (525.0, 320.0, 240.0), 1.0, k1=-0.1)

    (doubt,) = assess(folder, CONFIG).doubts

    assert "a radial distortion k1 of -0.10 (+- 0.00) that was not given" in doubt


@pytest.mark.parametrize(
    ("fitted_px", "sigma_px"),
    [((515.0, 310.0, 250.0), 1.0), ((500.0, 300.0, 200.0), 10.0), ((800.0, 320.0, 240.0), 9.0)],
)
def test_a_camera_that_is_near_or_hardly_known_is_no_doubt(
    folder: MapFolder, fitted_px: tuple[float, ...], sigma_px: float
) -> None:
    say_camera(folder, fitted_px, sigma_px, k1=0.05)

    assert assess(folder, CONFIG).doubts == ()


def test_the_images_of_a_rendered_room_fit_its_camera(folder: MapFolder) -> None:
    (fit,) = folder.report("optimise")["values"]["camera_fits"]

    # The noise of a map of so few frames, and rounding of pixels at its edges.
    little_px = 0.01 * fit["given"][0]
    assert fit["fitted"][:3] == pytest.approx(fit["given"][:3], abs=little_px)
    assert max(fit["sigma"]) < little_px


def test_a_verdict_is_on_the_map_as_it_was_judged(folder: MapFolder) -> None:
    judged(folder, CONFIG)
    assert overview(folder)["quality"]["verdict"] == "good"

    other = dataclasses.replace(
        CONFIG, optimise=dataclasses.replace(CONFIG.optimise, bundle_rounds=1)
    )
    optimise.run(folder, other)

    assert not has_verdict(folder)
    assert overview(folder)["quality"] is None


def test_poses_that_are_nowhere_are_not_compared(folder: MapFolder, altering: Altering) -> None:
    leave_out(folder, altering, slice(len(load_odometry(folder).frames) // 2, None))

    assert assess(folder, CONFIG).values["revisits"] == 0
