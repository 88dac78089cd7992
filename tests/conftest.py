"""Fixtures that several parts' tests share; made once a session, read-only."""

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def tiny_capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A TUM folder of one synthetic room: 60 frames of 320 x 240 that close a loop, 4 photos."""
    from vnav.synthetic import MINIATURE, write_capture  # numba: only where it is needed

    folder = tmp_path_factory.mktemp("captures") / "miniature"
    write_capture(folder, MINIATURE)
    return folder
