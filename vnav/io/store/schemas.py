"""What every stored table must hold: types, shapes, ranges, and how its columns belong together.

Loops that are compiled index by what is stored, and look at no bounds: it is checked here, once,
when a table is loaded.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.core.map_index import ranges
from vnav.errors import MapError
from vnav.io.formats.arrays_file import Arrays, load_arrays
from vnav.io.store.map_folder import MapFolder

Sizes = Mapping[str, int]  # of the dimensions that are called by a letter
MOST_PATHS = 1000  # that are followed down a tree
KINDS = {"whole": np.integer, "real": np.floating, "byte": np.uint8, "flag": np.bool_}


@dataclass(frozen=True)
class Column:
    """One array: a length in its shape is a number, a name for the same length everywhere, or any.

    No value is less than ``low``, or as much as ``below``: a number, or the name of a length.
    ``gaps``: values that are not finite are legal.
    """

    kind: str
    shape: tuple[int | str | None, ...]
    low: float | None = None
    below: float | str | None = None
    gaps: bool = False
    needed: bool = True

    def problem(self, values: NDArray[Any], sizes: dict[str, int]) -> str | None:
        """What is wrong, None where nothing is; lengths that are new are added to the sizes."""
        if not np.issubdtype(values.dtype, KINDS[self.kind]):
            return f"values of type {values.dtype}"
        if not self._fits(values.shape, sizes):
            return f"shape {values.shape}"
        if self.kind == "real" and not self.gaps and not np.isfinite(values).all():
            return "values that are not finite"
        below = sizes[self.below] if isinstance(self.below, str) else self.below
        if self.low is not None and (values < self.low).any():
            return f"values below {self.low:g}"
        if below is not None and (values >= below).any():
            return f"values of {below:g} and more"
        return None

    def _fits(self, shape: tuple[int, ...], sizes: dict[str, int]) -> bool:
        if len(shape) != len(self.shape):
            return False
        lengths = zip(shape, self.shape, strict=True)
        wanted = [
            sizes.setdefault(want, length) if isinstance(want, str) else want
            for length, want in lengths
        ]
        return all(want in (None, length) for length, want in zip(shape, wanted, strict=True))


Relation = Callable[[Arrays], bool]


@dataclass(frozen=True)
class Schema:
    """The columns of a table by name, and what must hold between them, by what is expected."""

    columns: Mapping[str, Column]
    relations: Mapping[str, Relation]

    def checked(self, arrays: Arrays, path: Path, mend: str, sizes: Sizes) -> Arrays:
        """The arrays of a file; MapError where they are not such a table."""
        known = dict(sizes)
        for name, column in self.columns.items():
            if name not in arrays and not column.needed:
                continue
            found = "none"
            if name in arrays:
                found = column.problem(arrays[name], known) or ""
            if found:
                raise _unlike(f"'{name}' as vnav writes it", path, found, mend)
        if others := sorted(set(arrays) - set(self.columns)):
            raise _unlike("no other arrays than vnav's", path, others[0], mend)
        for sentence, holds in self.relations.items():
            if not holds(arrays):
                raise _unlike(sentence, path, "otherwise", mend)
        return arrays


def _unlike(expected: str, path: Path, found: str, mend: str) -> MapError:
    return MapError(f"expected {expected} in {path}, found {found}; {mend}")


def _starts(name: str, owners: str, rows: str, least: int = 0) -> Relation:
    """Each owner has the rows from its start to the next one's, so many at least: all the rows."""

    def holds(arrays: Arrays) -> bool:
        start = arrays[name].astype(np.int64)
        if len(start) != len(arrays[owners]) + 1:
            return False
        begins_and_ends = start[0] == 0 and start[-1] == len(arrays[rows])
        return bool(begins_and_ends and (np.diff(start) >= least).all())

    return holds


def _is_tree(arrays: Arrays) -> bool:
    """Children lie behind their parent, a level deeper, inside the table, each of one parent."""
    first, count = (arrays[name].astype(np.int64) for name in ("first_child", "children"))
    level, inner = arrays["level"], np.flatnonzero(arrays["children"])
    if not len(level) or level[0] != 0 or (np.diff(level) < 0).any():
        return False
    if (first[inner] <= inner).any() or (first[inner] + count[inner] > len(level)).any():
        return False
    parent = np.repeat(inner, count[inner])
    child = ranges(first[inner], first[inner] + count[inner])[1]
    return bool(len(np.unique(child)) == len(child) and (level[child] == level[parent] + 1).all())


_ROW = Column("whole", ("E",), 0, "N")
_EDGES = Schema(
    {
        "i": _ROW,
        "j": _ROW,
        "T_i_j": Column("real", ("E", 4, 4)),
        "information": Column("real", ("E", 6, 6)),
        "probability": Column("real", ("E",), 0),
    },
    {"probabilities of at most 1": lambda arrays: bool((arrays["probability"] <= 1).all())},
)

SCHEMAS = {
    "odometry/frames": Schema(
        {
            "capture": Column("whole", ("N",), 0),
            "index": Column("whole", ("N",), 0),
            "stamp_s": Column("real", ("N",)),
            "depth_after_s": Column("real", ("N",), gaps=True),
            "T_segment_camera": Column("real", ("N", 4, 4), gaps=True),
            "segment": Column("whole", ("N",), -1, "N"),
            "given": Column("flag", ()),
            "moving_share": Column("real", (None,), gaps=True),
            "T_world_before": Column("real", ("N", 4, 4), gaps=True, needed=False),
            "has_scale": Column("flag", (), needed=False),
            "light": Column("real", (None, 3), 0, needed=False),
        },
        {
            "light of each capture": lambda arrays: (
                len(arrays.get("light", ())) in (0, len(np.unique(arrays["capture"])))
            ),
        },
    ),
    "odometry/edges": _EDGES,
    "odometry/degenerate_edges": _EDGES,
    "odometry/alternatives": _EDGES,
    "odometry/keyframes": Schema(
        {
            "row": Column("whole", ("K",), 0, "N"),
            "count": Column("whole", ("K",), 0),
            "keypoints_px": Column("real", ("F", 2)),
            "descriptors": Column("byte", ("F", "W")),
            "scores": Column("real", ("F",)),
            "scales_px": Column("real", ("F",), 0),
            "angles_rad": Column("real", ("F",)),
            "points_camera": Column("real", ("F", 3), gaps=True),
        },
        {
            "counts that add up to all features": lambda arrays: (
                int(arrays["count"].sum()) == len(arrays["scores"])
            ),
            "rows that ascend": lambda arrays: bool((np.diff(arrays["row"]) > 0).all()),
        },
    ),
    "vocabulary/tree": Schema(
        {
            "centres": Column("byte", ("T", "W")),
            "first_child": Column("whole", ("T",), 0),
            "children": Column("whole", ("T",), 0),
            "level": Column("whole", ("T",), 0),
            "paths_followed": Column("whole", (), 1, MOST_PATHS + 1, needed=False),
        },
        {"a tree": _is_tree},
    ),
    "loops/edges": _EDGES,
    "loops/matches": Schema({"matches": Column("whole", ("M", 4), 0)}, {}),
    "optimise/map": Schema(
        {
            "T_world_camera": Column("real", ("N", 4, 4), gaps=True),
            "keyframe_covariance": Column("real", ("K", 6, 6), gaps=True),
            "depth_delay_s": Column("real", ("N",)),
            "points_world": Column("real", ("L", 3)),
            "sigma_m": Column("real", ("L",), 0, gaps=True),
            "landmark": Column("whole", ("M",), 0, "L"),
            "keyframe": Column("whole", ("M",), 0, "K"),
            "feature": Column("whole", ("M",), 0),
        },
        {},
    ),
    "optimise/edges": _EDGES,
    "fuse/departed": Schema({"landmarks": Column("flag", ("L",))}, {}),
    "index/index": Schema(
        {
            "points_world": Column("real", ("L", 3)),
            "sigma_m": Column("real", ("L",), 0, gaps=True),
            "retired": Column("flag", ("L",)),
            "descriptors": Column("byte", ("D", "W")),
            "owner": Column("whole", ("D",), 0, "L"),
            "described_start": Column("whole", (None,), 0),
            "described": Column("whole", ("D",), 0, "D"),
            "patch_world": Column("real", ("D", 3)),
            "span": Column("whole", ("T", 2), 0),
            "seen_start": Column("whole", (None,), 0),
            "T_world_keyframe": Column("real", ("K", 4, 4), gaps=True),
            "keyframe_covariance": Column("real", ("K", 6, 6), gaps=True),
            "seen_by": Column("whole", ("M",), 0, "K"),
            "sees_start": Column("whole", (None,), 0),
            "sees": Column("whole", ("M",), 0, "L"),
            "neighbours": Column("whole", ("L", None), 0, "L"),
            "covisible": Column("flag", ("K", "K")),
            "solid_away": Column("byte", (None, None, None)),
            "solid_origin": Column("real", (3,)),
            "solid_m": Column("real", (1,), 1e-6),
            "distractor_distance": Column("real", (1,), 0, gaps=True),
        },
        {
            "rows of the descriptors below nodes": lambda arrays: bool(
                (arrays["span"][:, 0] <= arrays["span"][:, 1]).all()
                and (arrays["span"] <= len(arrays["descriptors"])).all()
            ),
            "landmarks that share out their descriptors": _starts(
                "described_start", "points_world", "described"
            ),
            "landmarks that were each seen": _starts("seen_start", "points_world", "seen_by", 1),
            "keyframes that share out what they see": _starts("sees_start", "covisible", "sees"),
        },
    ),
}


def load_table(folder: MapFolder, stage: str, name: str, mend: str, sizes: Sizes) -> Arrays:
    """A table of a finished stage; MapError where it is damaged or no such table.

    ``mend``: what to do then; ``sizes``: lengths that other tables have.
    """
    path = folder.file(stage, f"{name}.npz")
    return SCHEMAS[f"{stage}/{name}"].checked(load_arrays(path, mend), path, mend, sizes)
