from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from vnav.config import FeaturesConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.grid import FREE, OCCUPIED
from vnav.errors import CaptureError
from vnav.features import front_end
from vnav.features.matching import match
from vnav.synthetic import (
    DEMO,
    MINIATURE,
    SCENES,
    CaptureSpec,
    Scene,
    Sensor,
    apartment,
    cached_capture,
    one_room,
    rendered_capture,
    write_capture,
)
from vnav.synthetic.furniture import shelf, table
from vnav.synthetic.many_rooms import building
from vnav.synthetic.path import look
from vnav.synthetic.rendered_capture import camera_poses, photo_poses
from vnav.synthetic.repeating import ROOM_M, SHELF_M, shop, twin_rooms
from vnav.synthetic.scene import Box, Face, placed
from vnav.synthetic.sensor import measured_depth

CAMERA = MINIATURE.camera
SENSOR = Sensor()
WINGS = "building_10_wing_0", "building_10_wing_1", "building_10_wing_9"


@pytest.fixture(scope="module")
def room() -> Scene:
    return one_room(0)


@pytest.fixture(scope="module")
def flat() -> Scene:
    return apartment(0)


def pixels(camera: Intrinsics) -> np.ndarray:
    return np.moveaxis(np.indices((camera.height, camera.width))[::-1], 0, -1)


def interpolated(image: np.ndarray, px: np.ndarray) -> np.ndarray:
    """Bilinear values (M,) at pixels (M, 2)."""
    x, y = np.floor(px).astype(int).T
    u, v = (px - np.floor(px)).T
    above = image[y, x] * (1 - u) + image[y, x + 1] * u
    below = image[y + 1, x] * (1 - u) + image[y + 1, x + 1] * u
    return above * (1 - v) + below * v


def seen_again(scene: Scene, T_world_a: np.ndarray, T_world_b: np.ndarray) -> tuple:
    """Pixels (M, 2) of a and b whose point lies in b's image amid one plane; which are visible.

    Inverse depth is linear on a plane, so what b sees there is exact when interpolated; a point
    is visible where its own depth in b is just that: within float32's 24 bits, with 1e-5 to spare.
    """
    depth_a, depth_b = (scene.render_depth(CAMERA, T) for T in (T_world_a, T_world_b))
    points_a = CAMERA.unproject(pixels(CAMERA), depth_a).reshape(-1, 3)
    points_b = se3.transform(se3.inverse(T_world_b) @ T_world_a, points_a)
    px_b = CAMERA.project(points_b)
    inverse_b = 1 / depth_b.astype(float)
    bent = np.abs(cv2.Laplacian(inverse_b, cv2.CV_64F)) > 1e-5
    amid = ~cv2.dilate(bent.astype(np.uint8), np.ones((5, 5))).astype(bool)
    keep = ((px_b >= 0) & (px_b < np.array(CAMERA.size) - 1)).all(1)
    keep[keep] = amid[tuple(np.rint(px_b[keep]).astype(int).T[::-1])]
    seen_m = 1 / interpolated(inverse_b, px_b[keep])
    visible = np.abs(points_b[keep, 2] / seen_m - 1) < 1e-5
    # What is not visible is hidden in b: farther away than what b sees there, never nearer.
    assert (points_b[keep, 2] > seen_m)[~visible].all()
    return pixels(CAMERA).reshape(-1, 2)[keep], px_b[keep], visible


def test_depth_and_pose_of_two_frames_agree(room: Scene) -> None:
    poses = camera_poses(room, MINIATURE)
    _, _, visible = seen_again(room, poses[0], poses[3])
    assert len(visible) > 20_000
    assert visible.mean() > 0.95


def test_colour_lies_where_depth_says(room: Scene) -> None:
    poses = camera_poses(room, MINIATURE)
    px_a, px_b, visible = seen_again(room, poses[0], poses[3])
    gray_a, gray_b = (
        cv2.cvtColor(room.render_color(CAMERA, T), cv2.COLOR_RGB2GRAY) for T in poses[[0, 3]]
    )
    here = gray_a[tuple(px_a[visible].T[::-1])]

    def agreement(shift_px: float) -> float:
        px = np.clip(px_b[visible] + (shift_px, 0), 0, np.array(CAMERA.size) - 2)
        return float(np.corrcoef(here, interpolated(gray_b, px))[0, 1])

    assert agreement(0) > 0.97
    assert agreement(0) > max(agreement(-0.5), agreement(0.5))


@pytest.mark.parametrize("depth_m", [1.0, 2.0, 4.0])
def test_depth_noise_has_the_sigma_and_the_steps_of_the_sensor(depth_m: float) -> None:
    clean = np.full((480, 640), depth_m, np.float32)
    measured = measured_depth(clean, DEMO.camera, SENSOR, np.random.default_rng(0))
    assert (measured > 0).all()
    steps = SENSOR.focal_baseline_px_m / measured / SENSOR.disparity_step_px
    assert np.abs(steps - np.rint(steps)).max() < 1e-3
    # Gauss plus rounding, independent since sigma is half a step (Sheppard, within 3 %).
    step_m = SENSOR.disparity_step_px * depth_m**2 / SENSOR.focal_baseline_px_m
    sigma = np.hypot(SENSOR.depth_sigma_per_m2 * depth_m**2, step_m / np.sqrt(12))
    assert measured.std() == pytest.approx(sigma, rel=0.04)
    # The mean of 300,000 pixels is off by sigma^2 / z, since noise is even in disparity, not depth.
    assert measured.mean() == pytest.approx(depth_m, abs=1.5 * sigma**2 / depth_m + 0.02 * sigma)


@pytest.mark.parametrize(("depth_m", "share"), [(0.4, 0), (0.5, 1), (5.0, 1), (5.6, 0)])
def test_there_is_depth_within_the_range_only(depth_m: float, share: float) -> None:
    clean = np.full((240, 320), depth_m, np.float32)
    measured = measured_depth(clean, CAMERA, SENSOR, np.random.default_rng(0))
    assert (measured > 0).mean() == share


def test_depth_drops_out_along_edges_only() -> None:
    clean = np.full((480, 640), 3.0, np.float32)
    clean[:, 320:] = 2.0
    lost = measured_depth(clean, DEMO.camera, SENSOR, np.random.default_rng(0)) == 0
    assert lost[:, 319:321].mean() > 0.95
    # 2 x 480 draws: three standard deviations of the share are 0.044.
    assert lost[:, [318, 321]].mean() == pytest.approx(SENSOR.edge_loss, abs=0.045)
    assert not np.delete(lost, np.s_[318:322], 1).any()


@pytest.mark.parametrize(("angle_deg", "share"), [(45, 0.0), (80, 0.5), (87, 0.97)])
def test_depth_drops_out_at_grazing_angles(angle_deg: float, share: float) -> None:
    """A plane whose normal makes that angle with the rays of the middle column."""
    slope = np.tan(np.deg2rad(angle_deg))
    x = (np.arange(5) - 2) / 525.0
    clean = np.tile((2.0 / (1 - slope * x)).astype(np.float32), (2000, 1))
    camera = Intrinsics(5, 2000, 525.0, 1e9, 2.0, 999.5)
    lost = measured_depth(clean, camera, SENSOR, np.random.default_rng(0)) == 0
    # 2000 draws: three standard deviations of the share are 0.034 at most.
    assert lost[:, 2].mean() == pytest.approx(share, abs=0.035)


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(tmp_path: Path) -> None:
    def files(name: str, seed: int) -> dict[str, bytes]:
        spec = CaptureSpec("one_room", 3, 1, CAMERA, CAMERA.scaled(160, 120), seed=seed)
        write_capture(tmp_path / name, spec)
        found = sorted(p for p in (tmp_path / name).rglob("*") if p.is_file())
        return {p.relative_to(tmp_path / name).as_posix(): p.read_bytes() for p in found}

    first = files("first", 0)
    assert first == files("again", 0)
    other = files("other", 1)
    assert set(other) == set(first)
    same = {name for name in first if first[name] == other[name]}
    cameras, grid = {"camera.toml", "photos/camera.toml"}, {"truth/grid.pgm", "truth/grid.yaml"}
    assert same == {"rgb.txt", "depth.txt"} | cameras | grid


def test_a_capture_is_made_once_and_kept(tmp_path: Path) -> None:
    calls: list[str] = []
    spec = CaptureSpec("one_room", 2, 1, CAMERA.scaled(80, 60), CAMERA.scaled(80, 60))
    progress = lambda task, done, total: calls.append(task)  # noqa: E731
    folder = cached_capture(spec, tmp_path, progress)
    made = len(calls)
    assert made == 3
    assert cached_capture(spec, tmp_path, progress) == folder
    assert len(calls) == made
    assert list(tmp_path.iterdir()) == [folder.parent]
    assert (folder / "rgb.txt").is_file()


@pytest.mark.parametrize(("scene", "spec"), [(apartment, DEMO), (one_room, MINIATURE)])
def test_the_walk_takes_small_steps_and_ends_where_it_began(scene, spec: CaptureSpec) -> None:
    poses = camera_poses(scene(0), spec)
    assert se3.is_rigid(poses)
    steps = se3.inverse(poses[:-1]) @ poses[1:]
    assert np.linalg.norm(steps[:, :3, 3], axis=1).max() < 0.11
    assert np.rad2deg(se3.rotation_angle(steps)).max() < 7
    closing = se3.inverse(poses[0]) @ poses[-1]
    assert np.linalg.norm(closing[:3, 3]) < 0.1
    assert np.rad2deg(se3.rotation_angle(closing)) < 6


def test_every_stretch_of_the_demo_walk_has_features(flat: Scene) -> None:
    sift = front_end(FeaturesConfig())
    counts = [
        len(sift.extract(flat.render_color(DEMO.camera, T))) for T in camera_poses(flat, DEMO)[::20]
    ]
    assert min(counts) >= 500


def test_different_places_do_not_look_alike(flat: Scene) -> None:
    """Neighbours share most features; views with nothing in common no more than by chance."""
    sift = front_end(FeaturesConfig())
    poses = camera_poses(flat, DEMO)
    rows = [0, 2, 100, 130, 165]
    features = [sift.extract(flat.render_color(DEMO.camera, poses[row])) for row in rows]
    assert len(match(features[0], features[1], 0.8)) > 0.4 * len(features[0])
    for other in features[2:]:
        assert len(match(features[0], other, 0.8)) < 0.04 * len(features[0])


def test_equal_furniture_has_patterns_of_its_own() -> None:
    pieces = tuple(placed(shelf(1.0, 2), 1.0 + 2 * k, 1.0, 90) for k in range(2))
    scene = Scene(pieces, (0, 0, 5, 3, 2.5), (), 0)
    books = [scene._texture(k) for k, face in enumerate(scene.faces) if face.material == "books"]
    assert len(books) == 4
    a, b = (book.astype(float).ravel() for book in (books[0], books[2]))
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.5


def test_photos_are_taken_off_the_path_with_room_around(flat: Scene) -> None:
    photos, path = photo_poses(flat, DEMO), camera_poses(flat, DEMO)
    assert photos.shape == (DEMO.photos, 4, 4)
    distance = np.linalg.norm(photos[:, None, :3, 3] - path[:, :3, 3], axis=-1).min(1)
    assert distance.max() > 0.3
    grid = flat.grid(0.05, 0.1, 1.4)
    blocked = grid.centres_of(np.argwhere(grid.cells == OCCUPIED))
    clearance = np.linalg.norm(photos[:, None, :2, 3] - blocked, axis=-1).min(1)
    assert clearance.min() > 0.35


def test_the_true_grid_tells_what_stands_in_the_way() -> None:
    scene = Scene((placed(table(1.0, 0.6), 2.0, 1.5, 90),), (0, 0, 4, 3, 2.5), (), 0)

    def at(x: float, y: float, low_m: float = 0.1, high_m: float = 1.4) -> int:
        grid = scene.grid(0.05, low_m, high_m)
        row, column = grid.cells_at((x, y))
        return int(grid.cells[row, column])

    assert at(2.45, 1.75) == OCCUPIED
    assert at(2.0, 1.5) == OCCUPIED
    assert at(2.0, 1.5, high_m=0.6) == FREE
    assert at(2.6, 1.5) == FREE
    assert at(2.0, 1.9) == FREE


def test_a_cache_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CaptureError, match="XDG_CACHE_HOME"):
        cached_capture(MINIATURE, tmp_path / "file")


def test_what_another_process_has_rendered_meanwhile_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = replace(MINIATURE, frames=2, photos=0)

    def write(folder: Path, *_: object) -> None:
        monkeypatch.undo()
        cached_capture(spec, tmp_path)
        folder.mkdir(parents=True)

    monkeypatch.setattr(rendered_capture, "write_capture", write)
    assert (cached_capture(spec, tmp_path) / "camera.toml").is_file()


@pytest.fixture(scope="module")
def twins() -> Scene:
    return twin_rooms(0)


def looking_at(position: tuple[float, float, float], yaw_deg: float) -> np.ndarray:
    """T_world_camera of a level camera."""
    zero = np.zeros(1)
    return look(np.array([position]), np.deg2rad([yaw_deg]), zero, zero)[0]


def test_twin_rooms_look_the_same(twins: Scene) -> None:
    """From the same place in either, unless one looks through the door or at the picture."""
    moved = np.array([ROOM_M, 0.0, 0.0])
    T = looking_at((0.9, 3.8, 1.2), 0.0)
    T_other = se3.make(T[:3, :3], T[:3, 3] + moved)
    one, other = (twins.render_color(CAMERA, pose).astype(int) for pose in (T, T_other))
    # Rounded coordinates may fall on the next texel, at edges.
    assert (np.abs(one - other).max(2) > 2).mean() < 0.01


def test_a_picture_tells_twin_rooms_apart(twins: Scene) -> None:
    T = looking_at((1.2, 4.2, 1.4), 90.0)
    T_other = se3.make(T[:3, :3], T[:3, 3] + [ROOM_M, 0.0, 0.0])
    one, other = (twins.render_color(CAMERA, pose).astype(int) for pose in (T, T_other))
    assert (np.abs(one - other).max(2) > 20).mean() > 0.05


def test_shelves_of_the_shop_are_the_same() -> None:
    """A shelf and its neighbour fill the image; the floor and the walls are out of sight."""
    place = shop(0)
    camera = Intrinsics(160, 120, 400.0, 400.0, 79.5, 59.5)
    first = looking_at((0.3 + SHELF_M / 2, 2.5, 1.2), -90.0)
    second = se3.make(first[:3, :3], first[:3, 3] + [SHELF_M, 0.0, 0.0])
    one, other = (place.render_color(camera, pose).astype(int) for pose in (first, second))
    assert (np.abs(one - other).max(2) > 2).mean() < 0.01
    assert one.std() > 20


@pytest.mark.parametrize("name", ["twin_rooms", "shop", "building_2", "building_20", *WINGS])
def test_the_tours_of_larger_scenes_are_free(name: str) -> None:
    scene = SCENES[name](0)
    spec = CaptureSpec(name, 60, 0, CAMERA, CAMERA)
    grid = scene.grid(0.05, 0.1, 1.4)
    cells = grid.cells_at(camera_poses(scene, spec)[:, :2, 3])
    assert (grid.cells[tuple(cells.T)] == FREE).all()


@pytest.mark.parametrize("name", ["apartment", "one_room", "twin_rooms", "two_storeys"])
def test_no_face_that_is_seen_lies_in_another(name: str) -> None:
    """Which of the two is seen would change with the camera's pose."""
    scene = SCENES[name](0)
    boxes = [box for piece in scene.pieces for box in piece]
    for k, face in enumerate(scene.faces):
        for other in scene.faces[k + 1 :]:
            if (
                face.normal @ other.normal > 0.999
                and abs((face.corner - other.corner) @ face.normal) < 1e-3
            ):
                before = shared(face, other) + 0.01 * face.normal
                assert all(any(holds(box, p) for box in boxes) for p in before), (face, other)


def shared(face: Face, other: Face) -> np.ndarray:
    """Points (N, 3) of a face, of an even grid, that lie in another of the same plane."""
    u, v = np.meshgrid(*[(np.arange(20) + 0.5) / 20] * 2)
    points = (face.corner + u[..., None] * face.u_edge + v[..., None] * face.v_edge).reshape(-1, 3)
    along = [
        (points - other.corner) @ edge / (edge @ edge) for edge in (other.u_edge, other.v_edge)
    ]
    return points[((np.array(along) > 0) & (np.array(along) < 1)).all(0)]


def holds(box: Box, point: np.ndarray) -> bool:
    """Whether a point lies in a box."""
    return bool((np.abs((point - box.centre) @ box.R_world_box) < np.array(box.size) / 2).all())


@pytest.mark.parametrize("field", ["scene", "motion", "thing"])
def test_a_specification_of_what_there_is_not_says_what_there_is(
    field: str, tmp_path: Path
) -> None:
    there_is = {"scene": "apartment", "motion": "static", "thing": "crate"}[field]
    with pytest.raises(CaptureError, match=f"the {field} .* one of .*{there_is}.* found 'atrium'"):
        write_capture(tmp_path / "none", replace(DEMO, **{field: "atrium"}))  # type: ignore[arg-type]


def test_a_building_has_as_many_rooms_as_asked() -> None:
    """Ten times the rooms have ten times the faces, but for the ends of the corridor."""
    few, many = (len(building(rooms)(0).faces) for rooms in (1, 10))
    assert 9.5 * few < many <= 10 * few


def test_recordings_of_neighbouring_wings_look_the_same_way_at_a_door() -> None:
    """Some of their views are within half a metre and 25 degrees."""
    one, other = (
        camera_poses(SCENES[name](0), CaptureSpec(name, 60, 0, CAMERA, CAMERA))
        for name in WINGS[:2]
    )
    apart_m = np.linalg.norm(one[:, None, :3, 3] - other[:, :3, 3], axis=-1)
    alike = np.einsum("ia,ja->ij", one[:, :3, 2], other[:, :3, 2])  # cosine between the views
    assert ((apart_m < 0.5) & (alike > np.cos(np.deg2rad(25)))).any()


def test_what_stays_in_a_room_looks_the_same_before_and_after() -> None:
    before, after = (SCENES[name](0) for name in ("room_before", "room_after"))
    faces = [{_where(face): k for k, face in enumerate(s.faces)} for s in (before, after)]
    staying = faces[0].keys() & faces[1].keys()
    assert len(staying) > 60
    for place in sorted(staying)[::4]:
        a, b = before._texture(faces[0][place]), after._texture(faces[1][place])
        np.testing.assert_array_equal(a, b)


def test_the_chair_that_moved_looks_as_it_did() -> None:
    looks = []
    for name in ("room_before", "room_after"):
        scene = SCENES[name](0)
        looks.append({f.twin: scene._texture(k) for k, f in enumerate(scene.faces) if f.twin})
    both = looks[0].keys() & looks[1].keys()
    assert len(both) > 30  # a seat, a back and four legs, of which five or six faces are seen
    for name in sorted(both):
        was, now = looks[0][name].astype(float), looks[1][name].astype(float)
        lit = now.mean() / was.mean()  # it turned, and light comes from one side
        np.testing.assert_allclose(now, lit * was, atol=2.5)  # both are rounded to whole levels


def _where(face: Face) -> tuple[float, ...]:
    return tuple(np.round([*face.corner, *face.u_edge, *face.v_edge], 6).tolist())
