"""The world frame from surfaces made of rectangles, given in a frame that is turned anyhow.

Surfaces lie 1 cm off at random. Thousands of points on a floor of some metres know its height to
1 cm / sqrt(1000) and its normal to that over 1 m: 0.3 mm, 0.02 degrees; ten times that is allowed.
"""

import numpy as np
import pytest

from vnav.config import Config, OptimiseConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.mapping import World
from vnav.features.description import near_depth
from vnav.optimisation.floor import AUTO, SIDES
from vnav.optimisation.surface import Surface, sample_surface
from vnav.optimisation.world import align_to_previous, existing_world, find_world, side_up

NOISE_M = 0.01
HEIGHT_M, TILT_DEG = 0.003, 0.2
T_any_room = se3.exp([0.7, -1.1, 0.4, 3.0, -2.0, 5.0])
Rectangle = tuple[list[float], list[float], list[float]]  # corner and two edges; seen from u x v
LOOKING_AHEAD = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # camera axes in the room

FLOOR: Rectangle = ([0, 0, 0], [4, 0, 0], [0, 4, 0])
STRIP: Rectangle = ([0, 3, 0], [3, 0, 0], [0, 0.5, 0])  # what is seen of a floor between furniture
CEILING: Rectangle = ([0, 0, 2.5], [0, 4, 0], [4, 0, 0])
WALLS: list[Rectangle] = [
    ([0, 0, 0], [0, 4, 0], [0, 0, 2.5]),
    ([4, 0, 0], [0, 0, 2.5], [0, 4, 0]),
    ([0, 0, 0], [0, 0, 2.5], [4, 0, 0]),
    ([0, 4, 0], [4, 0, 0], [0, 0, 2.5]),
]
TABLE: Rectangle = ([0.5, 0.5, 0.75], [3, 0, 0], [0, 2, 0])


def surface(*rectangles: Rectangle) -> Surface:
    """Points every 5 cm with their normals, noisy, in the frame "any"."""
    rng = np.random.default_rng(0)
    points, normals = [], []
    for corner, u, v in rectangles:
        size = np.linalg.norm([u, v], axis=1)
        a, b = (np.arange(0.025, s, 0.05) / s for s in size)
        at = np.stack(np.meshgrid(a, b), -1).reshape(-1, 2)
        normal = np.cross(u, v) / np.prod(size)
        off = NOISE_M * rng.standard_normal((len(at), 1)) * normal
        points.append(corner + at @ np.array([u, v]) + off)
        normals.append(np.broadcast_to(normal, at.shape[:1] + (3,)))
    R = T_any_room[:3, :3]
    return Surface(se3.transform(T_any_room, np.concatenate(points)), np.concatenate(normals) @ R.T)


def cameras(roll_deg: float = 0.0, pitch_deg: float = -15.0) -> np.ndarray:
    """Poses (16, 4, 4) in "any": a turn on the spot at 1.2 m; the first one looks along x."""
    yaw = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    turned = se3.exp_so3(np.outer(yaw, [0, 0, 1])) @ LOOKING_AHEAD
    pitched = turned @ se3.exp_so3([np.deg2rad(pitch_deg), 0, 0])
    rolled = pitched @ se3.exp_so3([0, 0, np.deg2rad(roll_deg)])
    return T_any_room @ se3.make(rolled, [2, 2, 1.2])


def found(
    seen: Surface, T_any_camera: np.ndarray, up_in_images: str = "auto"
) -> tuple[np.ndarray, World]:
    """``T_world_room`` and how it was found."""
    rng = np.random.default_rng(0)
    T_world_any, world = find_world(seen, T_any_camera, rng, up_in_images)
    assert se3.is_rigid(T_world_any)
    return T_world_any @ T_any_room, world


def tilt_deg(T_world_room: np.ndarray) -> float:
    return float(np.rad2deg(np.arccos(np.clip(T_world_room[2, 2], -1, 1))))


def assert_on_floor(result: tuple[np.ndarray, World], strip: bool = False) -> None:
    """A strip, half a metre wide, knows its own height as well, but its tilt five times worse."""
    T_world_room, world = result
    assert world.source == "floor"
    assert tilt_deg(T_world_room) < (5 if strip else 1) * TILT_DEG
    middle = [[1.5, 3.25, 0]] if strip else [[2, 2, 0]]
    assert abs(se3.transform(T_world_room, middle)[0, 2]) < HEIGHT_M


def test_z_is_up_and_zero_on_the_floor() -> None:
    T_world_room, world = found(surface(FLOOR, *WALLS), cameras())
    assert_on_floor((T_world_room, world))
    assert world.floor_rms_m == pytest.approx(NOISE_M, rel=0.1)
    assert world.floor_points > 0.9 * 80 * 80


def test_the_origin_lies_under_the_first_camera() -> None:
    T_world_room, _ = found(surface(FLOOR, *WALLS), cameras())
    np.testing.assert_allclose(
        se3.transform(T_world_room, [[2, 2, 0]])[0], [0, 0, 0], atol=2 * HEIGHT_M
    )


@pytest.mark.parametrize("first", [0, 3, 7, 13])
def test_x_runs_along_a_wall_to_where_the_first_camera_looks(first: int) -> None:
    T = np.roll(cameras(), -first, 0)
    T_world_room, _ = found(surface(FLOOR, *WALLS), T)
    along = np.abs(T_world_room[:3, :3])
    np.testing.assert_allclose(along, np.rint(along), atol=2 * np.deg2rad(TILT_DEG))
    forward = (T_world_room @ se3.inverse(T_any_room) @ T[0])[:3, 2]
    assert forward[0] > np.cos(np.deg2rad(46)) * np.hypot(*forward[:2])


def test_x_runs_along_the_walls_beside_furniture_that_stands_askew() -> None:
    # 7.5 m2 of it at 20 degrees turn the mean of 40 m2 of walls by 2.5 degrees. 16000 points that
    # lie 1 cm off know the walls' direction to 0.004 degrees; the finest step is of 0.02.
    c, s = np.cos(np.deg2rad(20)), np.sin(np.deg2rad(20))
    cupboards: list[Rectangle] = [
        ([1 + k * c, 0.5 + k * s, 0], [0, 0, 2.5], [-s, c, 0]) for k in (0.0, 0.7, 1.4)
    ]
    T_world_room, _ = found(surface(FLOOR, *WALLS, *cupboards), cameras())
    along = T_world_room[:2, :2]
    np.testing.assert_allclose(along, np.rint(along), atol=np.deg2rad(0.06))


def test_a_large_table_is_not_taken_for_the_floor() -> None:
    # 6 m2 of table, and only 1.5 m2 of the floor below it.
    assert_on_floor(found(surface(STRIP, TABLE, *WALLS), cameras()), strip=True)


def test_walls_are_not_taken_for_the_floor() -> None:
    # 40 m2 of walls, 1.5 m2 of floor.
    assert_on_floor(found(surface(STRIP, *WALLS), cameras()), strip=True)


def test_a_long_wall_beside_a_camera_that_hardly_turns_is_not_the_floor() -> None:
    wall: Rectangle = ([0, 0, 0], [0, 0, 2.5], [9, 0, 0])
    floor: Rectangle = ([0, 0, 0], [9, 0, 0], [0, 1.5, 0])
    yaw = np.deg2rad(np.linspace(-70, -20, 9))
    turned = se3.exp_so3(np.outer(yaw, [0, 0, 1])) @ LOOKING_AHEAD
    position = np.stack([np.linspace(1, 7, 9), np.full(9, 1.4), np.full(9, 1.2)], 1)
    assert_on_floor(found(surface(wall, floor), T_any_room @ se3.make(turned, position)))


def test_the_ceiling_is_not_taken_for_the_floor() -> None:
    seen = surface(STRIP, CEILING, *WALLS)
    assert_on_floor(found(seen, cameras(pitch_deg=10)), strip=True)


@pytest.mark.parametrize("roll_deg", [90, -90])
def test_what_stands_on_the_floor_tells_it_from_the_ceiling_to_a_camera_on_its_side(
    roll_deg: float,
) -> None:
    seen = surface(FLOOR, CEILING, TABLE, *WALLS)
    assert_on_floor(found(seen, cameras(roll_deg, pitch_deg=0)))


def test_a_camera_that_hangs_upside_down_and_looks_down_stands_on_its_floor() -> None:
    assert_on_floor(found(surface(FLOOR, TABLE, *WALLS), cameras(roll_deg=180)))


def test_a_ceiling_alone_is_no_floor_and_up_is_away_from_it() -> None:
    T_world_room, world = found(surface(CEILING, *WALLS), cameras(roll_deg=4, pitch_deg=10))
    assert world == World("structure", 0, None)
    assert tilt_deg(T_world_room) < TILT_DEG


@pytest.mark.parametrize("roll_deg", [0, 180])
def test_more_on_the_ceiling_than_on_the_floor_is_told_of(roll_deg: float) -> None:
    seen = surface(FLOOR, CEILING, TABLE, *WALLS)
    _, world = found(seen, cameras(roll_deg, pitch_deg=0))
    assert world.floor_less_stands == (roll_deg == 180)


def test_a_shelf_that_is_seen_from_below_does_not_make_the_ceiling_the_floor() -> None:
    shelf: Rectangle = ([0, 0.2, 1.8], [0, 3, 0], [0.4, 0, 0])
    assert_on_floor(found(surface(FLOOR, CEILING, shelf, *WALLS), cameras(pitch_deg=0)))


@pytest.mark.parametrize(("roll_deg", "side"), [(180, "bottom"), (90, "left"), (-90, "right")])
def test_the_side_of_the_images_that_is_up_can_be_named(roll_deg: float, side: str) -> None:
    seen = surface(FLOOR, CEILING, *WALLS)
    assert_on_floor(found(seen, cameras(roll_deg, pitch_deg=0), side))


@pytest.mark.parametrize("side", [AUTO, *SIDES])
def test_the_settings_know_every_side(side: str) -> None:
    assert OptimiseConfig(up_in_images=side).up_in_images == side


def test_without_a_floor_the_named_side_is_up() -> None:
    T_world_room, world = found(surface(*WALLS), cameras(roll_deg=180, pitch_deg=0), "bottom")
    assert world.source == "cameras"
    assert tilt_deg(T_world_room) < TILT_DEG


@pytest.mark.parametrize("roll_deg", [90, -90, 25])
def test_a_camera_held_upright_finds_the_same_floor(roll_deg: float) -> None:
    assert_on_floor(found(surface(FLOOR, *WALLS), cameras(roll_deg)))


@pytest.mark.parametrize("pitch_deg", [0, -35, -55])
def test_a_camera_that_looks_down_finds_the_same_floor(pitch_deg: float) -> None:
    assert_on_floor(found(surface(FLOOR, *WALLS), cameras(pitch_deg=pitch_deg)))


def test_a_camera_that_looks_straight_down_and_turns_about_stands_on_its_floor() -> None:
    assert_on_floor(found(surface(FLOOR, TABLE, *WALLS), cameras(pitch_deg=-85)))


def test_of_a_camera_that_looks_up_the_side_that_is_up_can_be_named() -> None:
    T_world_room, world = found(surface(CEILING, *WALLS), cameras(pitch_deg=85), "ahead")
    assert world.source == "structure"
    assert tilt_deg(T_world_room) < TILT_DEG


def test_a_wall_before_a_camera_that_does_not_turn_is_no_floor() -> None:
    facing = T_any_room @ se3.make(LOOKING_AHEAD, np.linspace([1, 0.5, 1.2], [1, 3.5, 1.2], 9))
    wall: Rectangle = ([3, 0, 0], [0, 4, 0], [0, 0, 2.5])
    T_world_room, world = found(surface(wall), facing)
    assert world == World("cameras", 0, None)
    assert tilt_deg(T_world_room) < TILT_DEG


@pytest.mark.parametrize("roll_deg", [0, 90, 180, -90])
@pytest.mark.parametrize("pitch_deg", [0, -85])
def test_how_the_cameras_were_held_is_told(roll_deg: float, pitch_deg: float) -> None:
    T_room_camera = se3.inverse(T_any_room) @ cameras(roll_deg, pitch_deg)
    side = {0: "top", 90: "left", 180: "bottom", -90: "right"}[int(roll_deg)]
    assert side_up(T_room_camera) == ("behind" if pitch_deg else side)


def test_reflections_below_the_floor_do_not_lower_it() -> None:
    # A mirror image of 0.25 m2 half a metre down: 0.5 % of 56 m2.
    mirrored: Rectangle = ([1, 1, -0.5], [0.5, 0, 0], [0, 0.5, 0])
    assert_on_floor(found(surface(FLOOR, mirrored, *WALLS), cameras()))


def test_without_a_floor_up_comes_from_what_is_level() -> None:
    # A table top and what stands under it; no floor. The cameras are held 4 degrees askew.
    shelf: Rectangle = ([0.5, 0.5, 0.2], [3, 0, 0], [0, 1.5, 0])
    deeper: Rectangle = ([0.5, 3, -0.4], [3, 0, 0], [0, 1, 0])
    under: Rectangle = ([0.5, 3, -0.9], [3, 0, 0], [0, 0, 0.5])
    high = cameras(roll_deg=4)
    high[:, :3, 3] += 3 * T_any_room[:3, 2]
    T_world_room, world = found(surface(TABLE, shelf, deeper, under, *WALLS), high)
    assert world == World("structure", 0, None)
    assert tilt_deg(T_world_room) < 2


def test_without_anything_level_up_comes_from_the_cameras() -> None:
    # The mean up of cameras that turn once around, 15 degrees down, is exactly the room's.
    T_world_room, world = found(surface(*WALLS), cameras())
    assert world == World("cameras", 0, None)
    assert tilt_deg(T_world_room) < 1
    lowest = se3.transform(T_world_room, [[0, 0, 0]])[0, 2]
    assert abs(lowest) < 0.1


def test_nothing_seen_at_all_leaves_the_cameras() -> None:
    nothing = Surface(np.zeros((0, 3)), np.zeros((0, 3)))
    T_world_room, world = found(nothing, cameras())
    assert world == World("cameras", 0, None)
    assert tilt_deg(T_world_room) < 1


def test_the_same_seed_gives_the_same_world() -> None:
    seen, T = surface(FLOOR, TABLE, *WALLS), cameras()
    first, second = (find_world(seen, T, np.random.default_rng(3))[0] for _ in range(2))
    assert first.tobytes() == second.tobytes()


CAMERA = Intrinsics(160, 120, 130.0, 130.0, 79.5, 59.5)


def depth_of(normal: list[float], offset: float) -> np.ndarray:
    """Depth image of the plane normal . p = offset in camera coordinates, 0 where not ahead."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    slope = CAMERA.unproject(np.stack([u, v], -1), np.ones(u.shape)) @ np.array(normal)
    return np.where(slope > 1e-6, offset / np.maximum(slope, 1e-6), 0).astype(np.float32)


def test_seen_surfaces_lie_on_the_plane_with_normals_towards_the_camera() -> None:
    # A floor 1.2 m below a level camera: y points down.
    near = near_depth(depth_of([0, 1, 0], 1.2), Config())
    seen = sample_surface([near], [CAMERA], np.eye(4)[None])
    assert len(seen.points) > 50
    np.testing.assert_allclose(seen.points[:, 1], 1.2, atol=1e-5)  # float32 of depth
    np.testing.assert_allclose(
        seen.normals, np.broadcast_to([0, -1, 0], seen.normals.shape), atol=1e-4
    )
    assert seen.points[:, 2].max() <= Config().odometry.max_depth_m


def test_a_surface_seen_again_counts_once() -> None:
    depth = depth_of([0, 0, 1], 2.0)
    once = sample_surface([depth], [CAMERA], np.eye(4)[None])
    twice = sample_surface([depth] * 2, [CAMERA] * 2, np.stack([np.eye(4)] * 2))
    np.testing.assert_array_equal(once.points, twice.points)


def test_no_surface_is_seen_across_a_depth_edge() -> None:
    # Half at 1 m, half at 3 m, both facing the camera: a bridge would face sideways.
    depth = depth_of([0, 0, 1], 1.0)
    depth[:, 80:] = 3.0
    seen = sample_surface([depth], [CAMERA], np.eye(4)[None])
    assert (seen.normals[:, 2] < -0.99).all()
    assert {round(float(z), 3) for z in seen.points[:, 2]} == {1.0, 3.0}


def test_no_depth_gives_no_surface() -> None:
    empty = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    assert len(sample_surface([empty], [CAMERA], np.eye(4)[None]).points) == 0
    assert len(sample_surface([], [], np.zeros((0, 4, 4))).points) == 0


def test_a_given_world_says_where_its_floor_lies() -> None:
    # "Any" is the world given: how the room lies in it is known.
    T_floor_given, found_world = find_world(
        surface(FLOOR, *WALLS), cameras(), np.random.default_rng(0)
    )
    world = existing_world(found_world, T_floor_given, cameras()[0], "given")
    up = T_any_room[:3, 2]
    foot = cameras()[0, :3, 3] - 1.2 * up  # the cameras are 1.2 m above the floor
    assert world.source == "given"
    assert world.floor_z_m == pytest.approx(foot[2], abs=HEIGHT_M + 1.2 * np.deg2rad(TILT_DEG))
    assert world.floor_tilt_deg == pytest.approx(np.rad2deg(np.arccos(up[2])), abs=TILT_DEG)
    assert "tilted by" in world.doubt


@pytest.mark.parametrize(
    "move",
    [
        np.array([[0.0, 0, 0]]).repeat(9, 0),
        np.outer(np.arange(9), [1.0, 0, 0]),
        np.random.default_rng(0).uniform(-3, 3, (9, 3)),
    ],
    ids=["on one spot", "on a line", "all over"],
)
def test_a_kept_world_is_found_wherever_the_cameras_stand(move: np.ndarray) -> None:
    # Poses err by 5 mrad and 5 mm on each side, and nine of them are averaged: their centres and
    # points 1 m off by 7 mm / 3; six times that.
    rng, T_world_any = np.random.default_rng(1), se3.exp([0.3, -0.5, 2.0, 4.0, -3.0, 1.0])
    noise = np.full(6, 0.005)
    T_any_camera = se3.make(se3.exp_so3(rng.uniform(-1, 1, (9, 3))), move)
    T_world_before = T_world_any @ T_any_camera @ se3.exp(noise * rng.standard_normal((9, 6)))
    T_world_before[4] = np.nan
    found = align_to_previous(
        T_world_before, T_any_camera @ se3.exp(noise * rng.standard_normal((9, 6)))
    )
    off = se3.inverse(T_world_any) @ found
    assert np.linalg.norm(off[:3, 3] + (off[:3, :3] - np.eye(3)) @ move.mean(0)) < 0.014
    assert se3.rotation_angle(off) < 0.014


def test_a_kept_world_says_where_its_floor_lies() -> None:
    world = existing_world(World("floor", 9, 0.0), np.eye(4), np.eye(4), "kept")
    assert (world.source, world.floor_z_m, world.floor_tilt_deg) == ("kept", 0.0, 0.0)
    assert world.doubt == ""


def test_a_given_world_in_which_no_floor_is_seen_says_so() -> None:
    world = existing_world(World("cameras", 0, None), np.eye(4), np.eye(4), "given")
    assert (world.source, world.floor_z_m, world.floor_tilt_deg) == ("given", None, None)
    assert world.doubt.startswith("no floor was seen")


def test_a_surface_is_the_same_however_much_is_sorted_out_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    depths = [depth_of([0, 0.1 * k, 1], 1.0 + 0.2 * k) for k in range(6)]
    poses = np.stack([se3.make(np.eye(3), [0.3 * k, 0, 0]) for k in range(6)])
    whole = sample_surface(depths, [CAMERA] * 6, poses)
    monkeypatch.setattr("vnav.optimisation.surface.AT_ONCE", 1)
    part = sample_surface(depths, [CAMERA] * 6, poses)
    np.testing.assert_array_equal(part.points, whole.points)
    np.testing.assert_array_equal(part.normals, whole.normals)
