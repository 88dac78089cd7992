"""Overlays of the photos located last, which a map keeps and its report shows."""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

import vnav
from vnav.io.store.map_folder import MapFolder
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.verdict.answer import UnreadablePhoto
from vnav.reporting import map_page
from vnav.reporting.located_photos import LONGEST_PX, MOST, MOST_BYTES, keeping_overlays
from vnav.stages.locate import Locator


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory, whole_map: Path) -> vnav.Map:
    """A map of its own, as photos are remembered in it."""
    root = tmp_path_factory.mktemp("maps") / "map"
    shutil.copytree(whole_map, root)
    return vnav.open_map(root)


@pytest.fixture
def folder(mapped: vnav.Map) -> MapFolder:
    """Without overlays."""
    folder = MapFolder(mapped.root)
    folder.write_overlays([])
    return folder


@pytest.fixture(scope="module")
def database(mapped: vnav.Map) -> Callable[[], LandmarkDatabase]:
    loaded = Locator.open(MapFolder(mapped.root), vnav.Config(), None).database
    return lambda: loaded


@pytest.fixture(scope="module")
def photos(tiny_capture: Path) -> list[Path]:
    return sorted((tiny_capture / "photos").glob("*.jpg"))


def decoded(jpeg: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image


def test_an_overlay_is_the_photo_with_what_was_found_in_it(
    mapped: vnav.Map, folder: MapFolder, photos: list[Path]
) -> None:
    mapped.locate(photos[0], remember=True)
    ((name, jpeg),) = folder.overlays()
    drawn, photo = decoded(jpeg), cv2.imread(str(photos[0]))
    photo = cv2.resize(photo, drawn.shape[1::-1], interpolation=cv2.INTER_AREA)
    assert name == photos[0].name
    # what is drawn covers a part of the photo; JPEG changes the rest by little
    assert np.median(cv2.absdiff(drawn, photo)) < 10
    assert greens(drawn) > greens(photo) + 100  # rings of 3 px around more than ten features


def greens(image: np.ndarray) -> int:
    """How many pixels are green, as no thing of the room is."""
    blue, green, red = image.astype(int).transpose(2, 0, 1)
    return int((green - np.maximum(blue, red) > 40).sum())


def test_of_photos_located_together_all_have_one(
    mapped: vnav.Map, folder: MapFolder, photos: list[Path], tmp_path: Path
) -> None:
    (tmp_path / "broken.jpg").write_text("none")
    list(mapped.locate_all([tmp_path / "broken.jpg", *photos], remember=True))
    assert [name for name, _ in folder.overlays()] == [photo.name for photo in photos]


def test_a_question_that_is_not_remembered_leaves_them(
    mapped: vnav.Map, folder: MapFolder, photos: list[Path]
) -> None:
    mapped.locate(photos[0])
    list(mapped.locate_all(photos))
    assert folder.overlays() == []


def test_a_photo_that_is_not_located_leaves_them(
    mapped: vnav.Map, folder: MapFolder, photos: list[Path]
) -> None:
    mapped.locate(photos[0], remember=True)
    before = folder.overlays()
    assert not mapped.locate(np.full((240, 320, 3), 128, np.uint8), remember=True).located
    assert folder.overlays() == before != []


def test_their_number_and_their_bytes_have_bounds(
    mapped: vnav.Map,
    folder: MapFolder,
    database: Callable[[], LandmarkDatabase],
    photos: list[Path],
    tmp_path: Path,
) -> None:
    noise = np.random.default_rng(0).normal(0, 20, (960, 1280, 3))
    large = cv2.resize(cv2.imread(str(photos[0])), (1280, 960)) + noise
    cv2.imwrite(str(tmp_path / "large.png"), large.clip(0, 255))
    answer = mapped.locate(tmp_path / "large.png", camera="auto")
    assert answer.located
    told = list(keeping_overlays(folder, database, (MOST + 2) * [answer]))
    assert len(told) == MOST + 2
    assert len(folder.overlays()) == MOST
    jpeg = folder.overlays()[0][1]
    assert max(decoded(jpeg).shape) == LONGEST_PX
    assert len(jpeg) <= MOST_BYTES


def test_a_photo_that_is_gone_or_was_pixels_has_none(
    mapped: vnav.Map,
    folder: MapFolder,
    database: Callable[[], LandmarkDatabase],
    photos: list[Path],
    tmp_path: Path,
) -> None:
    gone = Path(shutil.copyfile(photos[0], tmp_path / "gone.jpg"))
    answers = [mapped.locate(gone), mapped.locate(photos[1])]
    gone.unlink()
    pixels = cv2.cvtColor(cv2.imread(str(photos[0])), cv2.COLOR_BGR2RGB)
    answers += [mapped.locate(pixels), UnreadablePhoto(gone, "expected, found")]
    assert [answer.located for answer in answers] == [True, True, True, False]
    list(keeping_overlays(folder, database, answers))
    assert [name for name, _ in folder.overlays()] == [photos[1].name]


def test_answers_come_where_the_map_cannot_be_written(
    mapped: vnav.Map,
    folder: MapFolder,
    database: Callable[[], LandmarkDatabase],
    photos: list[Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(self: MapFolder, overlays: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(MapFolder, "write_overlays", refuse)
    answer = mapped.locate(photos[0], remember=True)
    assert answer.located


def test_the_report_shows_them(mapped: vnav.Map, folder: MapFolder, photos: list[Path]) -> None:
    assert "Photos located last" not in map_page.page(folder, "", {})
    list(mapped.locate_all(photos[:2], remember=True))
    text = map_page.page(folder, "", {})
    assert "Photos located last" in text
    assert text.count('src="data:image/jpeg;base64,') == 2
    assert f"<figcaption>{photos[1].name}</figcaption>" in text


def test_a_name_that_is_markup_is_text(folder: MapFolder) -> None:
    folder.write_overlays([('"><script>alert(1)', b"\xff\xd8\xff")])
    assert "<script>alert" not in map_page.page(folder, "", {})


@pytest.mark.parametrize("notes", [5, [5], [{"photo": "a"}], [{"photo": "a", "jpeg": "%"}], None])
def test_notes_that_vnav_did_not_write_are_none(folder: MapFolder, notes: object) -> None:
    folder._write_state("overlays", {"overlays": notes})
    assert folder.overlays() == []
