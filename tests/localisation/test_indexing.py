import numpy as np
import pytest

from vnav.core import se3
from vnav.localisation import indexing
from vnav.localisation.database import LandmarkDatabase


@pytest.fixture
def index(world):
    return world.database.index


def test_a_nodes_rows_are_the_descriptors_below_it(world, index):
    paths = world.database.tree.quantise(index.descriptors)
    for node in np.random.default_rng(0).choice(len(world.database.tree.level), 50, replace=False):
        rows = np.flatnonzero((paths == node).any(1))
        first, last = index.span[node]
        assert rows.tolist() == list(range(first, last))


def test_a_landmark_has_one_descriptor_per_word(world, index):
    words = world.database.tree.quantise(index.descriptors)[:, -1]
    # Means are quantised again, and a mean may fall into another's word: rarely.
    pairs = np.stack([index.owner, words], 1)
    assert len(np.unique(pairs, axis=0)) > 0.95 * len(pairs)
    assert set(index.owner.tolist()) == set(range(len(index.points_world)))


def test_visibility_reads_the_same_from_both_sides(index):
    which, keyframe = index.keyframes_of(np.arange(len(index.points_world), dtype=np.int32))
    by_landmark = set(zip(which.tolist(), keyframe.tolist(), strict=True))
    by_keyframe = {
        (landmark, k)
        for k in range(index.keyframes)
        for landmark in index.landmarks_of(np.array([k])).tolist()
    }
    assert by_landmark == by_keyframe


def test_neighbours_are_the_nearest_that_are_seen_together(index):
    home = index.seen_by[index.seen_start[:-1]]
    for landmark in np.random.default_rng(1).choice(len(index.points_world), 20, replace=False):
        distance = np.linalg.norm(index.points_world - index.points_world[landmark], axis=1)
        nearest = np.argsort(distance, kind="stable")[: 2 * index.neighbours.shape[1]]
        together = nearest[index.covisible[home[landmark], home[nearest]]]
        expected = together[: index.neighbours.shape[1]]
        assert set(index.neighbours[landmark].tolist()) == {landmark, *expected.tolist()}


def test_neighbours_are_the_same_however_few_are_sought_at_once(index, monkeypatch):
    """A query for all needs a gigabyte for half a million landmarks."""
    monkeypatch.setattr(indexing, "AT_ONCE", 50)
    reference, count = index.seen_by[index.seen_start[:-1]], index.neighbours.shape[1]
    found = indexing._neighbours(index.points_world, reference, index.covisible, count)
    assert len(found) > 4 * 50
    assert np.array_equal(found, index.neighbours)


def test_neighbours_never_lie_in_another_room(twin_world):
    index = twin_world.database.index
    room = index.points_world[:, 0] > 10
    assert (room[index.neighbours] == room[:, None]).all()


def test_patches_point_where_the_descriptors_are_oriented(world, index):
    """Seen from a keyframe, a patch's tip lies where the keyframe's feature said."""
    from vnav.localisation.view import View

    truth = {tuple(np.round(p, 4)): k for k, p in enumerate(world.things.points.astype(np.float32))}
    rows = np.flatnonzero(np.diff(index.seen_start)[index.owner] == 1)[:50]
    for row in rows:
        landmark = index.owner[row]
        keyframe = index.seen_by[index.seen_start[landmark]]
        view = View(se3.inverse(index.T_world_keyframe[keyframe]), world.camera)
        point = index.points_world[landmark : landmark + 1]
        tip = view.project(point + index.patch_world[row])[0] - view.project(point)[0]
        thing = truth[tuple(np.round(point[0], 4))]
        true_tip = view.project(point + world.things.patches[thing])[0] - view.project(point)[0]
        np.testing.assert_allclose(tip, true_tip, atol=1e-2)


def test_a_stranger_is_nearer_than_a_random_descriptor_and_farther_than_a_repetition(index):
    values = index.descriptors.astype(float)
    random = np.linalg.norm(values[:-1:2] - values[1::2], axis=1)
    assert 0 < index.distractor_distance[0] < np.median(random)


def test_words_of_rows_agree_with_their_paths(world, index):
    tree = world.database.tree
    paths = tree.quantise(index.descriptors)
    rows = np.arange(0, len(index.descriptors), 7)
    for level in (1, 2, tree.levels):
        expected = paths[rows, level]
        assert LandmarkDatabase(index, tree).words(rows, level).tolist() == expected.tolist()
