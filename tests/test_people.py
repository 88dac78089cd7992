"""People in rendered scenes: how they move, what they cover, and the truth about it."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from vnav.errors import CaptureError
from vnav.io.formats.trajectories import read_tum
from vnav.synthetic import MINIATURE, SCENES, write_capture
from vnav.synthetic.figure import Posture, dressed
from vnav.synthetic.masks import moving_around, read_moving_masks
from vnav.synthetic.people import Peopled, Walker, walkers_share
from vnav.synthetic.places import CLEARANCE_M, MOVES, NET_M, net_of
from vnav.synthetic.rendered_capture import camera_poses, with_walkers
from vnav.synthetic.sights import FILLED, covered, sight_of
from vnav.synthetic.strolls import STAND, STEP_S, WALK, stroll

CAMERA = MINIATURE.camera.scaled(80, 60)
SPEC = replace(MINIATURE, camera=CAMERA, photos=0, walkers=3, walker_share=0.2)
TIMES_S = np.arange(SPEC.frames) / SPEC.rate_hz
FASTEST_M_S = NET_M * np.hypot(*MOVES.T).max() / STEP_S


@pytest.fixture(scope="module")
def people() -> Peopled:
    found = with_walkers(SCENES[SPEC.scene](SPEC.seed), SPEC)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Some frames of the same walk, with people twice and without."""
    short = replace(SPEC, frames=10, rate_hz=1.0)
    specs = {"people": short, "again": short, "empty": replace(short, walkers=0)}
    folder = tmp_path_factory.mktemp("captures")
    for name, spec in specs.items():
        write_capture(folder / name, spec)
    return {name: folder / name for name in specs}


def files(folder: Path) -> dict[str, bytes]:
    found = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def test_masks_are_where_people_hide_the_scene(people: Peopled) -> None:
    for k in range(0, SPEC.frames, 10):
        T = camera_poses(people, SPEC)[k]
        moment = people.at(TIMES_S[k])
        mask = moment.render_walkers(CAMERA, T) > 0
        nearer = moment.render_depth(CAMERA, T) < people.scene.render_depth(CAMERA, T)
        np.testing.assert_array_equal(mask, nearer)


def test_colour_differs_from_the_empty_scene_on_people_alone(people: Peopled) -> None:
    T = camera_poses(people, SPEC)[20]
    moment = people.at(TIMES_S[20])
    mask = moment.render_walkers(CAMERA, T) > 0
    differs = (moment.render_color(CAMERA, T) != people.scene.render_color(CAMERA, T)).any(2)
    around = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3))) > 0  # a pixel's rays leave it
    assert not differs[~around].any()
    assert differs[mask].mean() > 0.95


def test_people_cover_the_share_that_is_asked_for(people: Peopled) -> None:
    masks = [
        people.at(t_s).render_walkers(CAMERA, T) > 0
        for t_s, T in zip(TIMES_S, camera_poses(people, SPEC), strict=True)
    ]
    assert np.mean(masks) == pytest.approx(SPEC.walker_share, rel=0.25)


def test_a_share_that_cannot_be_covered_is_refused() -> None:
    with pytest.raises(CaptureError, match="more or fewer walkers"):
        with_walkers(SCENES[SPEC.scene](0), replace(SPEC, frames=30, walkers=1, walker_share=0.9))


def test_everybody_walks_and_pauses(people: Peopled) -> None:
    for walker in people.walkers:
        x, y = np.array([(p.x_m, p.y_m) for p in map(walker.stroll.at, TIMES_S)]).T
        speed = np.hypot(np.gradient(x, TIMES_S), np.gradient(y, TIMES_S))
        # Quadratic splines are no faster than their fastest step; a seat is up to a step off.
        assert speed.max() <= FASTEST_M_S + 1e-6
        assert (speed > 0.4).mean() > 0.3
        still = [not walker.stroll.moves_at(t) for t in TIMES_S]
        assert 0.1 < np.mean(still) < 0.6


def test_somebody_sits_down_and_stands_up(people: Peopled) -> None:
    sit = np.array([[w.stroll.at(t).sit for w in people.walkers] for t in TIMES_S])
    seated = sit.max(1).argmax()
    assert sit.max() == 1
    walker = int(sit.max(0).argmax())
    assert sit[0, walker] == 0
    assert sit[seated:, walker].min() == 0


def test_where_there_are_no_seats_everybody_stands_in_pauses() -> None:
    """Every other one sits down where there are seats: of two, one."""
    spec = replace(SPEC, scene="library", frames=100, walkers=2)
    found = with_walkers(SCENES["library"](0), spec)
    assert found is not None
    times_s = np.arange(0, spec.frames / spec.rate_hz, STEP_S)
    for walker in found.walkers:
        assert isinstance(walker, Walker)
        assert max(walker.stroll.at(t).sit for t in times_s) == 0
        assert not all(walker.stroll.moves_at(t) for t in times_s)


def test_people_keep_clear_of_what_stands_in_the_room(people: Peopled) -> None:
    """The middle of who walks; a corner of the way is cut by an eighth of two steps at most."""
    grid = people.scene.grid(0.05, 0.05, 1.9)
    free = cv2.distanceTransform((grid.cells == 0).astype(np.uint8), cv2.DIST_L2, 5) * 0.05
    cut_m = 0.125 * 2 * FASTEST_M_S * STEP_S
    for walker in people.walkers:
        for posture in map(walker.stroll.at, TIMES_S):
            row, column = grid.cells_at((posture.x_m, posture.y_m))
            assert posture.sit > 0 or free[row, column] > CLEARANCE_M - cut_m - 0.05


def test_who_stands_two_seconds_is_still_and_walks_on() -> None:
    places = np.array([[0.5 * max(0, k - 4 * (k > 3)), 0] for k in range(4)] + [[1.5, 0]] * 5)
    places = np.vstack([places, places[-1] + np.outer(np.arange(1, 4), [0.5, 0])])
    kinds = [WALK] * 3 + [STAND] * 5 + [WALK] * 3
    way = stroll(places, kinds, np.full((len(places), 3), np.nan))
    times = np.arange(0, (len(places) - 1) * STEP_S, 0.01)
    moves = np.array([way.moves_at(t) for t in times])
    still = times[~moves]
    assert still[-1] - still[0] == pytest.approx(2.0, abs=0.03)
    assert moves[times < still[0]].all()
    assert moves[times > still[-1]].all()


def test_the_body_moves_as_one_and_stands_on_the_floor() -> None:
    figure = dressed(np.random.default_rng(0), (0,))
    for posture in (
        Posture(1.0, 2.0, 0.3, 0.0, 0.0, 0.0),
        Posture(1.0, 2.0, 0.3, 0.4, 1.0, 0.0),
        Posture(1.0, 2.0, 0.3, 0.0, 0.0, 1.0),
    ):
        faces = figure.rectangles(posture)
        corners = faces.corner + faces.v_edge
        assert corners[:, 2].min() == pytest.approx(0, abs=1e-9)
        # Faces keep their size and stay right-angled, whatever the posture.
        assert np.abs((faces.u_edge * faces.v_edge).sum(1)).max() < 1e-12
    assert figure.rectangles(Posture(0, 0, 0, 0, 0, 1)).corner[:, 2].max() < 1.45


def test_a_texture_stays_on_its_limb(people: Peopled) -> None:
    """Rectangles come in the order of their textures at all times, and with constant sizes."""
    first, later = (people.at(t).rectangles for t in (0.0, 5.3))
    assert len(people.textures.start) == len(first.corner)
    for edge in ("u_edge", "v_edge"):
        sizes = [np.linalg.norm(getattr(faces, edge), axis=1) for faces in (first, later)]
        np.testing.assert_allclose(*sizes, atol=1e-12)


def test_clothes_are_full_of_detail(people: Peopled) -> None:
    """None is flat, none black; nobody wears what another wears."""
    looks = [np.concatenate([i.reshape(-1, 3) for i in w.figure.images()]) for w in people.walkers]
    for look in looks:
        assert 40 < look.mean() < 200
        assert look.std() > 25
    assert len({look.tobytes() for look in looks}) == len(looks)


def test_people_change_nothing_but_pixels(captures: dict[str, Path]) -> None:
    people, empty = files(captures["people"]), files(captures["empty"])
    own = {name for name in people if name.startswith(("truth/masks/", "truth/moving"))}
    assert len(own) == 11
    assert set(people) == set(empty) | own
    differ = {name for name in empty if people[name] != empty[name]}
    assert differ
    assert all(name.startswith(("rgb/", "depth/")) for name in differ)
    poses = [read_tum(captures[name] / "groundtruth.txt") for name in ("people", "empty")]
    np.testing.assert_array_equal(poses[0].T_world_camera, poses[1].T_world_camera)


def test_people_are_the_same_every_time(captures: dict[str, Path]) -> None:
    assert files(captures["people"]) == files(captures["again"])


def test_masks_are_written_and_read(captures: dict[str, Path]) -> None:
    masks = read_moving_masks(captures["people"] / "truth")
    assert len(masks) == 10
    assert masks[0].shape == (CAMERA.height, CAMERA.width)
    written = cv2.imread(str(captures["people"] / "truth/masks/000004.png"), cv2.IMREAD_UNCHANGED)
    assert written.any()
    np.testing.assert_array_equal(masks[4], written > 0)  # no pause here takes six seconds


def test_who_rests_for_long_is_not_among_the_moving(people: Peopled) -> None:
    resting = people.walkers[0].stroll
    long = replace(resting, knots=np.repeat(resting.knots[:1], len(resting.knots), 0))
    calm = replace(people, walkers=(replace(people.walkers[0], stroll=long), people.walkers[1]))
    assert all(numbers in ([2], []) for numbers in moving_around(calm.walkers, TIMES_S))
    assert [2] in moving_around(calm.walkers, TIMES_S)


def test_the_share_is_that_of_the_pixels(people: Peopled) -> None:
    away = np.tile(camera_poses(people, SPEC)[:1], (3, 1, 1))
    away[:, 2, 3] = 30.0  # above the roof
    assert walkers_share(people, CAMERA, away) == 0


def test_what_a_place_covers_is_foreseen_and_others_are_allowed_for(people: Peopled) -> None:
    net, T = net_of(people.scene), camera_poses(people, SPEC)[20]
    sight = sight_of(people.scene.render_depth(CAMERA, T), net, CAMERA, T)
    alone, first = covered(sight, [])
    assert alone == 0
    node = np.array(np.unravel_index(first.argmax(), first.shape))
    theirs, second = covered(sight, [node])
    assert theirs == pytest.approx(first.max())
    # Who stands where somebody stands already adds only what the first left uncovered.
    assert second[tuple(node)] == pytest.approx((1 - FILLED) * first.max())
    assert (second <= first + 1e-12).all()
    assert (first[~net.free] == 0).all()
