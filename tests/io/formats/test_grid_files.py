from pathlib import Path

import numpy as np
import pytest

from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, WALKED, Grid
from vnav.errors import MapError
from vnav.io.formats.grid_files import read_grid, write_grid, write_walked

CELLS = np.array([[FREE, OCCUPIED, UNKNOWN], [UNKNOWN, FREE, FREE]], np.uint8)
YAML = """\
image: "map.pgm"   # as map_saver writes it
resolution: 0.1
origin: [1.5, -2, 0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
mode: trinary
"""


def _map_server_files(folder: Path, text: str = YAML, pixels: bytes = b"\xfe\x00\xcd") -> Path:
    (folder / "map.pgm").write_bytes(b"P5\n# CREATOR: map_saver\n3 1\n255\n" + pixels)
    (folder / "map.yaml").write_text(text)
    return folder / "map.yaml"


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    grid = Grid((-1.35, 0.1 + 0.2), 0.05, CELLS)
    write_grid(tmp_path, grid)
    read = read_grid(tmp_path / "grid.yaml")
    assert (read.origin, read.resolution_m) == (grid.origin, grid.resolution_m)
    np.testing.assert_array_equal(read.cells, grid.cells)


def test_the_image_shows_y_upwards_in_the_greys_of_map_server(tmp_path: Path) -> None:
    write_grid(tmp_path, Grid((0, 0), 0.05, CELLS))
    assert (tmp_path / "grid.pgm").read_bytes() == b"P5\n3 2\n255\n\xcd\xfe\xfe\xfe\x00\xcd"


def test_walked_cells_are_unknown_in_the_grid_and_free_in_an_image_of_their_own(
    tmp_path: Path,
) -> None:
    grid = Grid((-1.35, 0.1 + 0.2), 0.05, np.array([[FREE, WALKED], [OCCUPIED, UNKNOWN]], np.uint8))
    write_grid(tmp_path, grid)
    write_walked(tmp_path, grid)
    assert read_grid(tmp_path / "grid.yaml").cells.tolist() == [
        [FREE, UNKNOWN],
        [OCCUPIED, UNKNOWN],
    ]
    walked = read_grid(tmp_path / "walked.yaml")
    assert (walked.origin, walked.resolution_m) == (grid.origin, grid.resolution_m)
    assert walked.cells.tolist() == [[UNKNOWN, FREE], [UNKNOWN, UNKNOWN]]


def test_a_grid_that_map_server_wrote_is_read(tmp_path: Path) -> None:
    grid = read_grid(_map_server_files(tmp_path))
    assert (grid.origin, grid.resolution_m) == ((1.5, -2.0), 0.1)
    assert grid.cells.tolist() == [[FREE, OCCUPIED, UNKNOWN]]


def test_in_a_negated_image_light_is_occupied(tmp_path: Path) -> None:
    grid = read_grid(_map_server_files(tmp_path, YAML.replace("negate: 0", "negate: 1")))
    assert grid.cells.tolist() == [[OCCUPIED, FREE, OCCUPIED]]  # 205 of 255 is 0.80


def test_thresholds_divide_grey_values(tmp_path: Path) -> None:
    # occupancy of a grey value v is (255 - v) / 255: 89 is 0.651, 90 is 0.647; 206 is 0.192
    grid = read_grid(_map_server_files(tmp_path, pixels=b"\x59\x5a\xce"))
    assert grid.cells.tolist() == [[OCCUPIED, UNKNOWN, FREE]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("resolution: 0.1\n", ""), "resolution"),
        (("resolution: 0.1", "resolution: fine"), "fine"),
        (("resolution: 0.1", "resolution: 0"), "resolution 0"),
        (("-2, 0]", "-2, 0.5]"), "yaw 0.5"),
        (("-2, 0]", "-2]"), "unpack"),
        (("mode: trinary", "mode: scale"), "mode scale"),
        (('"map.pgm"', "gone.pgm"), "gone.pgm"),
        (('"map.pgm"', "a\0b.pgm"), "a name that no file can have"),
        (('"map.pgm"', "/dev/zero"), "no regular file"),
    ],
)
def test_a_description_that_cannot_be_followed_is_named(
    tmp_path: Path, change: tuple[str, str], message: str
) -> None:
    path = _map_server_files(tmp_path, YAML.replace(*change))
    with pytest.raises(MapError, match=message):
        read_grid(path)


def test_a_truncated_image_is_an_error(tmp_path: Path) -> None:
    path = _map_server_files(tmp_path, pixels=b"\xfe\x00")
    with pytest.raises(MapError, match=r"map\.pgm, found none that is whole"):
        read_grid(path)


def test_a_missing_description_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"grid\.yaml"):
        read_grid(tmp_path / "grid.yaml")
