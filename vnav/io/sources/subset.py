"""Some frames of a capture, as a capture."""

import dataclasses
import hashlib
import json
from collections.abc import Sequence

from vnav.core.arrays import Array
from vnav.core.frame import Frame
from vnav.io.sources.capture import Capture
from vnav.io.sources.derived import DerivedCapture


class Subset(DerivedCapture):
    """The frames of a capture in these rows, ascending; its name, its camera, its poses."""

    def __init__(self, capture: Capture, rows: Sequence[int]) -> None:
        super().__init__(capture)
        self._rows = list(rows)

    @property
    def stamps_s(self) -> Array:
        """Times (N,) of the chosen frames."""
        return super().stamps_s[self._rows]

    def __len__(self) -> int:
        return len(self._rows)

    def read(self, index: int) -> Frame:
        """A chosen frame, by its place among the chosen."""
        return dataclasses.replace(super().read(self._rows[index]), index=index)

    def fingerprint(self) -> str:
        """A hash of the whole capture's, and of the rows."""
        content = json.dumps([super().fingerprint(), self._rows])
        return hashlib.sha256(content.encode()).hexdigest()
