"""Arrays on disk: what numpy reads, and what numpy would have written."""

from pathlib import Path

import numpy as np
import pytest

from vnav.io.formats.arrays_file import load_arrays, save_arrays

PARTS = [np.arange(12, dtype=np.float32).reshape(3, 4), np.zeros((0, 4), np.float32)]
PARTS += [-PARTS[0][::-1], np.ones((5, 4), np.float32)[:, ::-1]]


def test_arrays_are_what_they_were(tmp_path: Path) -> None:
    save_arrays(tmp_path / "a.npz", scalar=np.array(True), parts=PARTS, whole=PARTS[0].T)
    found = load_arrays(tmp_path / "a.npz", "")
    assert found["scalar"].shape == ()
    np.testing.assert_array_equal(found["parts"], np.concatenate(PARTS))
    np.testing.assert_array_equal(found["whole"], PARTS[0].T)


def test_parts_are_written_as_numpy_writes_the_whole(tmp_path: Path) -> None:
    save_arrays(tmp_path / "parts.npz", values=PARTS)
    np.savez(tmp_path / "whole.npz", values=np.concatenate(PARTS))
    assert (tmp_path / "parts.npz").read_bytes() == (tmp_path / "whole.npz").read_bytes()


def test_objects_are_never_pickled(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="Object arrays"):
        save_arrays(tmp_path / "a.npz", values=np.array([{}], object))
