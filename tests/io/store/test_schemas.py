"""What crafted tables hold is refused before anything indexes by it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.errors import MapError
from vnav.io.formats.arrays_file import Arrays, load_arrays
from vnav.io.store.schemas import SCHEMAS, Column

PATH, MEND = Path("table.npz"), "run it again"


@pytest.fixture(scope="module")
def tables(whole_map: Path) -> dict[str, Arrays]:
    """Every table of a map."""
    return {name: load_arrays(whole_map / f"{name}.npz", MEND) for name in SCHEMAS}


@pytest.fixture(scope="module")
def sizes(tables: dict[str, Arrays]) -> dict[str, int]:
    return {"N": len(tables["odometry/frames"]["index"])}


def check(name: str, arrays: Arrays, sizes: dict[str, int]) -> None:
    SCHEMAS[name].checked(arrays, PATH, MEND, sizes)


@pytest.mark.parametrize("name", SCHEMAS)
def test_what_vnav_writes_is_legal(
    name: str, tables: dict[str, Arrays], sizes: dict[str, int]
) -> None:
    check(name, tables[name], sizes)


def test_every_table_that_a_stage_writes_has_a_schema(whole_map: Path) -> None:
    found = {path.relative_to(whole_map).with_suffix("") for path in whole_map.glob("*/*.npz")}
    assert {path.as_posix() for path in found} == set(SCHEMAS)


COLUMNS = [(name, column) for name in SCHEMAS for column in SCHEMAS[name].columns]


def spoilt(column: Column, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """The values with each flaw that a column like this can have; some have no rows to spoil."""
    found = {
        "of another type": values.astype(str),
        "of more dimensions": values[None],
    }
    if column.shape and values.size:
        found["without the last row"] = values[:-1]
    if column.kind == "whole" and values.size:
        for flaw, number in (("huge", 2**31 - 1), ("negative", -(2**31))):
            found[flaw] = values.astype(np.int64)
            found[flaw].flat[-1] = number
    if column.kind == "real" and not column.gaps and values.size:
        found["not a number"] = values.copy()
        found["not a number"].flat[-1] = np.nan
    return found


@pytest.mark.parametrize(("name", "column"), COLUMNS)
def test_a_flaw_of_a_column_is_named(
    name: str, column: str, tables: dict[str, Arrays], sizes: dict[str, int]
) -> None:
    schema, table = SCHEMAS[name].columns[column], tables[name]
    if column not in table:
        pytest.skip("no such column in a map of one capture")
    bounded = schema.below is not None
    for flaw, values in spoilt(schema, table[column]).items():
        alone = len([c for c in SCHEMAS[name].columns.values() if schema.shape[:1] == c.shape[:1]])
        if flaw == "without the last row" and (alone == 1 or schema.shape[0] is None):
            continue
        if flaw == "huge" and not bounded:
            continue
        with pytest.raises(MapError, match=r"expected .* in table\.npz, found .*; run it again"):
            check(name, table | {column: values}, sizes)


@pytest.mark.parametrize("name", SCHEMAS)
def test_a_missing_column_and_one_too_many_are_named(
    name: str, tables: dict[str, Arrays], sizes: dict[str, int]
) -> None:
    first, *_ = tables[name]
    without = {key: values for key, values in tables[name].items() if key != first}
    with pytest.raises(MapError, match=f"expected '{first}' as vnav writes it"):
        check(name, without, sizes)
    with pytest.raises(MapError, match="expected no other arrays"):
        check(name, tables[name] | {"planted": np.zeros(1)}, sizes)


RELATIONS = {
    "index/index": {
        "described_start": "landmarks that share out their descriptors",
        "seen_start": "landmarks that were each seen",
        "sees_start": "keyframes that share out what they see",
    },
    "odometry/keyframes": {
        "count": "counts that add up to all features",
        "row": "rows that ascend",
    },
}


@pytest.mark.parametrize(
    ("name", "column", "sentence"),
    [(name, column, text) for name, texts in RELATIONS.items() for column, text in texts.items()],
)
def test_columns_that_do_not_belong_together_are_named(
    name: str, column: str, sentence: str, tables: dict[str, Arrays], sizes: dict[str, int]
) -> None:
    values = tables[name][column].copy()
    values[1] = values[-1] + 1 if column == "count" else values[-1]
    with pytest.raises(MapError, match=f"expected {sentence} in"):
        check(name, tables[name] | {column: values}, sizes)


@pytest.mark.parametrize(
    ("column", "row", "value"),
    [
        ("first_child", 0, 0),  # its own child: a walk would never end
        ("first_child", 0, 10**6),
        ("children", 0, 10**6),
        ("level", 0, 1),
        ("level", -1, 1),
        ("first_child", 0, 2),  # a child of two
    ],
)
def test_nodes_that_are_no_tree_are_refused(
    column: str, row: int, value: int, tables: dict[str, Arrays]
) -> None:
    tree = tables["vocabulary/tree"]
    values = tree[column].copy()
    values[row] = value
    with pytest.raises(MapError, match=r"expected a tree in table\.npz"):
        check("vocabulary/tree", tree | {column: values}, {})


def test_an_index_of_another_tree_is_refused(tables: dict[str, Arrays]) -> None:
    nodes = len(tables["vocabulary/tree"]["level"])
    check("index/index", tables["index/index"], {"T": nodes})
    with pytest.raises(MapError, match="'span'"):
        check("index/index", tables["index/index"], {"T": nodes + 1})
