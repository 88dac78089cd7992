import dataclasses
import json
import shutil
import struct
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from vnav.config import Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.errors import MapError, PhotoError
from vnav.io.formats.trajectories import read_tum
from vnav.io.store.artifacts import load_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.localisation.prior import PlacePrior
from vnav.localisation.verdict.answer import UnreadablePhoto, summary
from vnav.localisation.verdict.decision import Located, NotLocated
from vnav.reporting import inset, overlay
from vnav.reporting.photo_table import CSV_HEADER, photo_table
from vnav.stages.locate import (
    UNDEREXPOSED,
    Locator,
    brightened,
    locate,
    locate_each,
    remember,
    scaled_down,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, whole_map: Path) -> MapFolder:
    root = tmp_path_factory.mktemp("maps") / "whole"
    shutil.copytree(whole_map, root)
    return MapFolder(root)


@pytest.fixture(scope="module")
def locator(folder: MapFolder) -> Locator:
    return Locator.open(folder, Config())


@pytest.fixture(scope="module")
def photos(tiny_capture: Path) -> list[Path]:
    return sorted((tiny_capture / "photos").glob("*.jpg"))


@pytest.fixture(scope="module")
def truth(tiny_capture: Path, folder: MapFolder) -> dict[str, np.ndarray]:
    """T_world_camera of each photo in the world of the map."""
    true = read_tum(tiny_capture / "groundtruth.txt").T_world_camera[:, :3, 3]
    mapped = load_optimised(folder).T_world_camera[:, :3, 3]
    T_world_truth = se3.align(mapped, true)
    lines = (tiny_capture / "photos" / "groundtruth.txt").read_text().splitlines()
    rows = [line.split() for line in lines if not line.startswith("#")]
    return {
        name: T_world_truth
        @ se3.make(se3.rotation_from_quat(np.array(q, float)), np.array([x, y, z], float))
        for name, x, y, z, *q in rows
    }


def test_photos_are_found_where_they_were_taken(
    locator: Locator, photos: list[Path], truth: dict[str, np.ndarray]
) -> None:
    for photo in photos:
        answer = locator.locate(photo)
        assert answer.best is not None, summary(answer)
        offset = se3.inverse(truth[photo.name]) @ answer.best.view.T_world_camera
        # The map of 320 x 240 frames is itself off by centimetres.
        assert np.linalg.norm(offset[:3, 3]) < 0.10
        assert np.rad2deg(se3.rotation_angle(offset)) < 3


def test_a_photo_turned_on_its_side_is_found(
    locator: Locator, photos: list[Path], tmp_path: Path
) -> None:
    upright = locator.locate(photos[0])
    image = cv2.rotate(cv2.imread(str(photos[0])), cv2.ROTATE_90_CLOCKWISE)
    cv2.imwrite(str(tmp_path / "side.png"), image)
    answer = locator.locate(tmp_path / "side.png")
    assert answer.camera.source == "estimated"  # no camera.toml beside it
    assert answer.best is not None
    assert upright.best is not None
    off_m = answer.best.view.centre_world - upright.best.view.centre_world
    assert np.linalg.norm(off_m) < 0.15


def test_a_black_photo_is_refused_as_dark(locator: Locator, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "black.png"), np.zeros((480, 640, 3), np.uint8))
    answer = locator.locate(tmp_path / "black.png")
    assert answer.best is None
    assert answer.reason.startswith("too few features; the photo is dark")
    assert not answer.as_dict()["located"]


def test_a_blurred_photo_is_refused_as_blurred(
    locator: Locator, photos: list[Path], tmp_path: Path
) -> None:
    image = cv2.GaussianBlur(cv2.imread(str(photos[0])), (0, 0), 14)
    cv2.imwrite(str(tmp_path / "blurred.png"), image)
    answer = locator.locate(tmp_path / "blurred.png")
    assert answer.best is None
    assert answer.reason.endswith("; the photo is blurred")


def test_all_places_of_an_ambiguous_photo_are_told(locator: Locator, photos: list[Path]) -> None:
    answer = locator.locate(photos[0])
    best = answer.best
    assert best is not None
    view = best.view.moved(np.array([0, 0, 0, 1.0, 0, 0]))
    moved = dataclasses.replace(best, refined=dataclasses.replace(best.refined, view=view))
    result = NotLocated("ambiguous", 10, 9, (best, moved), (0.6, 0.4))
    unsure = dataclasses.replace(answer, result=result, reason="ambiguous")
    for place in (best, moved):
        x, y, z = place.view.centre_world
        assert f"{x:.2f} {y:.2f} {z:.2f} m" in summary(unsure)
    assert [h["probability"] for h in unsure.as_dict()["hypotheses"]] == [0.6, 0.4]


def test_a_sequence_reports_what_the_photos_before_told(
    locator: Locator, photos: list[Path], tmp_path: Path
) -> None:
    """Photos that are located by themselves have the same answers, and say that they are."""
    noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "noise.png"), noise)
    asked = [tmp_path / "none.jpg", photos[0], tmp_path / "noise.png", photos[1]]
    values = [answer.as_dict() for answer in locate_each(locator, asked, sequence=True)]
    assert ["prior" in value for value in values] == [False, False, True, True]
    assert not values[2]["located"]
    told, step_m = values[3].pop("prior"), locator.config.locate.sequence_step_m
    assert (told["photo"], told["needed"]) == (str(photos[0]), False)
    assert told["position_m"] == values[1]["position_m"]
    assert told["reach_m"] == 2 * step_m  # since the photo before the noise
    alone = locator.locate(photos[1]).as_dict()
    assert {**values[3], "seconds": None} == {**alone, "seconds": None}


def test_a_pose_that_the_photos_before_hold_is_said_to_be_so(
    locator: Locator, photos: list[Path], tmp_path: Path
) -> None:
    answer = locator.locate(photos[0])
    prior = PlacePrior("before.jpg", np.zeros(3), 0.99, 1.0)
    result = answer.result
    assert isinstance(result, Located)
    held = dataclasses.replace(answer, result=dataclasses.replace(result, prior=prior), prior=prior)
    assert held.as_dict()["prior"]["needed"]
    assert summary(held).endswith("; held by the photos before")
    assert "held by" not in summary(dataclasses.replace(answer, prior=prior))
    with photo_table(tmp_path / "poses.csv") as add_row:
        add_row(held)
    assert ",True,held by the photos before," in (tmp_path / "poses.csv").read_text()


def test_noise_is_refused(locator: Locator, tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (480, 640, 3)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "noise.png"), noise)
    answer = locator.locate(tmp_path / "noise.png")
    assert answer.best is None
    assert answer.as_dict()["T_world_camera"] is None


def test_json_has_the_fields_that_the_design_names(locator: Locator, photos: list[Path]) -> None:
    value = locator.locate(photos[0]).as_dict()
    assert list(value) == [
        *("photo", "located", "reason", "T_world_camera", "position_m", "quaternion_xyzw"),
        *("intrinsics", "intrinsics_source", "features", "matches", "inliers"),
        *("sigma_position_m", "sigma_rotation_deg", "confidence", "hypotheses", "seconds"),
    ]
    assert Config().locate.min_confidence <= value["confidence"] <= 1
    assert value["hypotheses"][0]["T_world_camera"] == value["T_world_camera"]
    T = np.array(value["T_world_camera"])
    np.testing.assert_allclose(se3.rotation_from_quat(value["quaternion_xyzw"]), T[:3, :3])
    json.dumps(value, allow_nan=False)


def test_a_photo_is_answered_the_same_alone_and_among_others(
    locator: Locator, photos: list[Path]
) -> None:
    together = list(locate(locator, photos))
    for photo, answer in zip(photos, together, strict=True):
        alone = locator.locate(photo).as_dict()
        among = answer.as_dict()
        assert {**alone, "seconds": 0} == {**among, "seconds": 0}


def test_an_unreadable_photo_does_not_stop_the_others(
    locator: Locator, photos: list[Path], tmp_path: Path
) -> None:
    broken = tmp_path / "broken.jpg"
    broken.write_text("no image")
    first, second = locate(locator, [broken, photos[0]])
    assert isinstance(first, UnreadablePhoto)
    assert "broken.jpg" in first.reason
    assert not isinstance(second, UnreadablePhoto)
    with pytest.raises(PhotoError, match=r"broken\.jpg"):
        locator.locate(broken)


def test_a_located_photo_becomes_the_current_pose(
    folder: MapFolder, locator: Locator, photos: list[Path]
) -> None:
    answer = locator.locate(photos[1])
    assert remember(folder, answer) is None
    current = folder.current()
    assert current is not None
    assert current["T_world_camera"] == answer.as_dict()["T_world_camera"]


def test_a_photo_that_was_not_located_leaves_the_current_pose(
    folder: MapFolder, locator: Locator, photos: list[Path], tmp_path: Path
) -> None:
    remember(folder, locator.locate(photos[1]))
    before = folder.current()
    cv2.imwrite(str(tmp_path / "black.png"), np.zeros((48, 64, 3), np.uint8))
    remember(folder, locator.locate(tmp_path / "black.png"))
    assert folder.current() == before


def test_a_map_that_cannot_be_written_is_told(
    folder: MapFolder, locator: Locator, photos: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: MapFolder, pose: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(MapFolder, "write_current", refuse)
    problem = remember(folder, locator.locate(photos[0]))
    assert problem is not None
    assert "Permission denied" in problem


def test_a_wrongly_assumed_camera_is_doubted(
    locator: Locator, photos: list[Path], tmp_path: Path
) -> None:
    """A photo scaled to the map's size, taken with another field of view, no camera.toml by it."""
    mapped = locator.map_cameras[0]
    image = cv2.imread(str(photos[0]))
    height, width = image.shape[:2]
    cut = image[: round(width * 0.6) * 3 // 4, : round(width * 0.6)]
    cv2.imwrite(str(tmp_path / "photo.png"), cv2.resize(cut, mapped.size))
    answer = locator.locate(tmp_path / "photo.png")
    assert answer.camera.source == "assumed"
    assert answer.best is None or "focal length" in answer.warnings[0]


def test_a_raw_frame_of_the_recording_is_placed_by_its_lens(
    folder: MapFolder, locator: Locator, tmp_path: Path
) -> None:
    """The map was made of frames without distortion, and the camera still has it."""
    lens = dataclasses.replace(locator.map_cameras[0], distortion=(0.26, -0.95, -0.005, 0.003, 1.2))
    capture = folder.captures[0] | {"recorded_camera": dataclasses.asdict(lens)}
    shutil.copytree(folder.root, tmp_path / "map")
    bent = MapFolder(tmp_path / "map")
    bent.set_captures([capture])
    frame = locator.keyframe(5)
    cv2.imwrite(str(tmp_path / "raw.png"), seen_through(lens, frame.color)[..., ::-1])
    truth = load_optimised(folder).T_world_camera[frame.index]
    answers = [Locator.open(m, Config()).locate(tmp_path / "raw.png") for m in (bent, folder)]
    assert answers[0].camera.source == "assumed"
    off_m = [np.linalg.norm(a.best.view.centre_world - truth[:3, 3]) for a in answers if a.best]
    assert off_m[0] < 0.01
    assert len(off_m) == 1 or off_m[1] > 2 * off_m[0]


def seen_through(lens: Intrinsics, image: np.ndarray) -> np.ndarray:
    """What a lens makes of an image without distortion."""
    v, u = np.mgrid[: lens.height, : lens.width].astype(np.float32)
    px = np.stack([u, v], -1).reshape(-1, 1, 2)
    straight = cv2.undistortPoints(px, lens.K, np.array(lens.distortion), P=lens.K)
    x, y = straight.reshape(lens.height, lens.width, 2).transpose(2, 0, 1)
    return cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def with_exif(photo: Path, focal_px: float, size: tuple[int, int], out: Path) -> Path:
    """The photo with an EXIF that tells a focal length, as its 35 mm equivalent."""
    equivalent = round(focal_px * 43.267 / float(np.hypot(*size)))
    image = struct.pack("<HHHIIIHHHIHHI", 1, 0x8769, 4, 1, 26, 0, 1, 0xA405, 3, 1, equivalent, 0, 0)
    block = b"Exif\0\0II*\0" + struct.pack("<I", 8) + image
    jpeg = photo.read_bytes()
    out.write_bytes(jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + jpeg[2:])
    return out


@pytest.mark.parametrize(("factor", "source"), [(1.0, "exif"), (0.5, "estimated")])
def test_an_exif_that_the_matches_refuse_is_not_believed(
    factor: float, source: str, locator: Locator, photos: list[Path], tmp_path: Path
) -> None:
    mapped = locator.map_cameras[0]
    photo = with_exif(photos[0], factor * mapped.fx, mapped.size, tmp_path / "photo.jpg")
    told, known = locator.locate(photo), locator.locate(photos[0])
    assert told.camera.source == source
    assert told.best is not None
    assert known.best is not None
    # Rounded to a millimetre of the equivalent, EXIF is off by 2 %: 6 cm at 3 m.
    off = told.best.view.centre_world - known.best.view.centre_world
    assert np.linalg.norm(off) < 0.06


def test_the_table_has_a_line_for_each_photo(
    locator: Locator, photos: list[Path], tmp_path: Path
) -> None:
    answers = [locator.locate(photos[0]), UnreadablePhoto(Path("x.jpg"), "expected, found")]
    table = tmp_path / "poses.csv"
    with photo_table(table) as add_row:
        for rows, answer in enumerate(answers, 1):
            add_row(answer)
            assert len(table.read_text().splitlines()) == 1 + rows  # already now
    header, good, bad = table.read_text().splitlines()
    assert header.split(",") == list(CSV_HEADER)
    assert len(good.split(",")) == len(CSV_HEADER)
    assert float(good.split(",")[-1]) == pytest.approx(answers[0].confidence, abs=1e-4)
    assert bad.startswith('x.jpg,False,"expected, found",')


def test_the_overlay_shows_the_photo_and_the_map_beside_it(
    locator: Locator, photos: list[Path], tmp_path: Path
) -> None:
    answer = locator.locate(photos[0])
    overlay.draw(answer, locator.database, tmp_path / "new" / "overlay.png")
    drawn, photo = cv2.imread(str(tmp_path / "new" / "overlay.png")), cv2.imread(str(photos[0]))
    height, width = photo.shape[:2]
    legend = drawn[height:]
    assert drawn.shape[1] > width
    assert (drawn[:height, :width] != photo).any()
    assert (drawn[:height, width:] == inset.GREEN).all(2).any()
    for color in (overlay.BLUE, overlay.GREEN, overlay.YELLOW):
        assert (legend == color).all(2).any()


def test_the_camera_is_drawn_where_it_stands_in_the_map(
    locator: Locator, photos: list[Path]
) -> None:
    """A dot as far from the map's corner as the camera is, to the pixel."""
    answer, voxels = locator.locate(photos[0]), locator.database.index.voxels
    drawn = inset.Inset(voxels, 1000)
    assert answer.best is not None
    drawn.draw(answer.best, (0, 0, 255))
    low = voxels.origin[:2] - inset.MARGIN_M
    high = voxels.origin[:2] + voxels.edge_m * np.array(voxels.solid.shape[:2]) + inset.MARGIN_M
    share = (answer.best.view.centre_world[:2] - low) / (high - low)
    height, width = drawn.image.shape[:2]
    x, y = round(share[0] * width), round((1 - share[1]) * height)
    assert (drawn.image[y - 2 : y + 3, x - 2 : x + 3] == (0, 0, 255)).all(2).sum() > 12


def test_the_overlay_of_an_unknown_place_is_drawn_as_well(locator: Locator, tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (480, 640, 3)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "noise.png"), noise)
    overlay.draw(locator.locate(tmp_path / "noise.png"), locator.database, tmp_path / "o.png")
    assert (cv2.imread(str(tmp_path / "o.png")) == inset.RED).all(2).any()


def test_large_photos_are_scaled_down_and_small_ones_left() -> None:
    assert scaled_down(np.zeros((3000, 4000, 3), np.uint8), 1600).shape == (1200, 1600, 3)
    assert scaled_down(np.zeros((30, 40, 3), np.uint8), 1600).shape == (30, 40, 3)


def test_a_photo_darkened_to_a_quarter_is_found(
    locator: Locator, photos: list[Path], tmp_path: Path
) -> None:
    shutil.copy(photos[0].parent / "camera.toml", tmp_path)
    cv2.imwrite(str(tmp_path / "dark.png"), cv2.imread(str(photos[0])) // 4)
    found, dark = locator.locate(photos[0]), locator.locate(tmp_path / "dark.png")
    assert found.best is not None
    assert dark.best is not None
    assert len(dark.photo.features) > 0.5 * len(found.photo.features)
    off_m = dark.best.view.centre_world - found.best.view.centre_world
    assert np.linalg.norm(off_m) < 0.05


def test_a_photo_that_is_bright_enough_is_left_alone() -> None:
    bright = np.full((4, 4, 3), 200, np.uint8)
    assert brightened(bright) is bright
    black = np.zeros((4, 4, 3), np.uint8)
    assert brightened(black) is black


def test_a_photo_is_brightened_by_its_brightest_hundredth() -> None:
    ramp = np.repeat(np.arange(100, dtype=np.uint8), 12).reshape(20, 20, 3)  # 98 % is below 98
    np.testing.assert_allclose(brightened(ramp), ramp * UNDEREXPOSED / 98, atol=0.51)
    lamp = ramp.copy()
    lamp[0, :2] = 255  # 0.5 % of it
    np.testing.assert_allclose(brightened(lamp)[1:], ramp[1:] * UNDEREXPOSED / 99, atol=0.51)


def test_the_maps_own_feature_settings_are_used(folder: MapFolder, locator: Locator) -> None:
    recorded = folder.settings("odometry")["features"]
    used = dataclasses.asdict(locator._front_end._config)
    assert used == recorded | {"max_features": Config().locate.max_features}


def test_a_damaged_index_is_told_before_the_first_photo_comes(
    folder: MapFolder, tmp_path: Path
) -> None:
    def never() -> Iterator[Path]:
        raise AssertionError("a photo was asked for")
        yield

    damaged = MapFolder(shutil.copytree(folder.root, tmp_path / "map"))
    (damaged.root / "index" / "index.npz").write_bytes(b"PK")
    with pytest.raises(MapError, match="index.npz"):
        next(locate_each(Locator.open(damaged, Config()), never()))
