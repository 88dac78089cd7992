"""Some frames of a capture, as a capture."""

import dataclasses
import hashlib
import json
from collections.abc import Sequence

from vnav.core.arrays import Array
from vnav.core.camera import Camera
from vnav.core.frame import Frame
from vnav.core.trajectory import Trajectory
from vnav.io.sources.capture import Capture


class Subset:
    """The frames of a capture in these rows, ascending; its name, its camera, its poses."""

    def __init__(self, capture: Capture, rows: Sequence[int]) -> None:
        self._whole, self._rows = capture, list(rows)

    @property
    def name(self) -> str:
        """That of the whole."""
        return self._whole.name

    @property
    def camera(self) -> Camera:
        """That of the whole."""
        return self._whole.camera

    @property
    def has_depth(self) -> bool:
        """Whether the whole has."""
        return self._whole.has_depth

    @property
    def stamps_s(self) -> Array:
        """Times (N,) of the chosen frames."""
        return self._whole.stamps_s[self._rows]

    @property
    def poses(self) -> Trajectory | None:
        """Those of the whole: poses belong to frames by their times."""
        return self._whole.poses

    def __len__(self) -> int:
        return len(self._rows)

    def read(self, index: int) -> Frame:
        """A chosen frame, by its place among the chosen."""
        return dataclasses.replace(self._whole.read(self._rows[index]), index=index)

    def fingerprint(self) -> str:
        """A hash of the whole capture's, and of the rows."""
        content = json.dumps([self._whole.fingerprint(), self._rows])
        return hashlib.sha256(content.encode()).hexdigest()
