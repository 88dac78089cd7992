from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from vnav.config import load
from vnav.config.registries import SEARCHES


@pytest.fixture(scope="module")
def patent(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("patent")


def test_every_way_is_one_that_settings_can_name(patent: ModuleType) -> None:
    assert load(patent.WAYS["default"]) == load()
    assert load(patent.WAYS["patent"]) != load()
    assert load(settings=[patent.FLAT]).vocabulary.method == "approximate"
    for origin, *levels in patent.LEVELS.values():
        found = load(settings=[f"locate.levels_from={origin}"])
        assert found.locate.levels_from == origin
        assert levels == [3, 5]
    assert set(SEARCHES) > {"compound", "interleaved"}


def test_photos_are_counted_by_their_errors(patent: ModuleType) -> None:
    off = np.array([[0.01, 1.0], [0.02, 3.0], [0.40, 1.0]])
    asked, than = patent.Asked(5, off, 0.4), patent.Asked(5, off, 0.2)
    found = {(m.quantity, m.unit): m.value for m in asked.measurements("house", "patent", than)}
    assert found["photos asked", ""] == 5
    assert found["located", ""] == 3
    assert found["within 5 cm and 2 deg", ""] == 1
    assert found["wrong", ""] == 1
    assert found["median error", "cm"] == 2.0
    assert found["time of a photo, ratio", ""] == 2.0


def test_only_the_default_must_not_be_wrong(
    patent: ModuleType, missed: Callable[..., list[object]]
) -> None:
    asked = patent.Asked(1, np.array([[1.0, 1.0]]), 0.4)
    assert len(missed(asked.measurements("house", "default", None))) == 1
    assert not missed(asked.measurements("house", "patent", None))


def test_of_no_located_photo_there_is_no_median(patent: ModuleType) -> None:
    asked = patent.Asked(3, np.zeros((0, 2)), 0.4)
    assert "median error" not in {m.quantity for m in asked.measurements("h", "patent", None)}
