import numpy as np
import pytest

from vnav.features.sift import SPACE
from vnav.localisation.inverted_file import InvertedFile, nearest_distinct


def database(rng, count=300):
    descriptors = rng.integers(0, 256, (count, 128)).astype(np.uint8)
    position = rng.uniform(0, 1, (count, 3)).astype(np.float32)
    return InvertedFile(descriptors, position, 0.3, SPACE)


def by_hand(query, first, last, db, count):
    """The definition, one query at a time."""
    distance = np.linalg.norm(db.descriptors[first:last].astype(float) - query, axis=1)
    rows, distances = [], []
    for _ in range(count):
        k = int(distance.argmin())
        rows.append(first + k)
        distances.append(distance[k])
        offset = np.abs(db.position[first:last] - db.position[first + k]).max(1)
        distance[offset < db.same_within] = np.inf
    return rows, distances


@pytest.mark.parametrize("lengths", [40, [30, 60]], ids=["all of their own", "shared"])
def test_it_agrees_with_the_definition(lengths):
    rng = np.random.default_rng(0)
    db = database(rng)
    queries = rng.integers(0, 256, (40, 128)).astype(np.uint8)
    first = rng.choice([0, 50, 120], 40)
    span = np.stack([first, first + rng.choice(lengths, 40) + 20], 1).astype(np.int32)
    rows, distances = nearest_distinct(queries, span, db, 2)
    for k in range(40):
        expected_rows, expected = by_hand(queries[k].astype(float), *span[k], db, 2)
        assert rows[k].tolist() == expected_rows
        np.testing.assert_allclose(distances[k], expected, rtol=1e-6)


def test_a_sole_candidate_has_no_second_nearest():
    db = database(np.random.default_rng(1))
    _, distances = nearest_distinct(db.descriptors[:1], np.array([[7, 8]], np.int32), db, 2)
    assert np.isfinite(distances[0, 0])
    assert np.isinf(distances[0, 1])


def test_what_lies_in_the_same_place_is_no_second_nearest():
    rng = np.random.default_rng(2)
    db = database(rng, 2)
    together = InvertedFile(db.descriptors, np.zeros((2, 3), np.float32), 0.3, SPACE)
    _, distances = nearest_distinct(db.descriptors[:1], np.array([[0, 2]], np.int32), together, 2)
    assert distances[0, 0] == 0
    assert np.isinf(distances[0, 1])
