import numpy as np
import pytest

from vnav.core.tree import CHUNK, VocabularyTree
from vnav.features.sift import SPACE


@pytest.fixture
def tree() -> VocabularyTree:
    """A root with two children; the second has two leaves of its own."""
    centres = np.zeros((5, 128), np.uint8)
    centres[1:, 0] = [10, 100, 90, 110]
    return VocabularyTree(
        centres,
        np.array([1, 0, 3, 0, 0]),
        np.array([2, 0, 2, 0, 0]),
        np.array([0, 1, 1, 2, 2]),
        SPACE,
    )


def descriptors(*firsts: int) -> np.ndarray:
    values = np.zeros((len(firsts), 128), np.uint8)
    values[:, 0] = firsts
    return values


def test_a_path_leads_through_the_nearest_centre_of_each_level(tree: VocabularyTree) -> None:
    assert tree.quantise(descriptors(92, 108)).tolist() == [[0, 2, 3], [0, 2, 4]]


def test_a_shallow_leaf_repeats_itself(tree: VocabularyTree) -> None:
    assert tree.quantise(descriptors(12)).tolist() == [[0, 1, 1]]


def test_no_descriptors_have_no_paths(tree: VocabularyTree) -> None:
    assert tree.quantise(descriptors()).shape == (0, 3)


def test_chunks_leave_no_seam(tree: VocabularyTree) -> None:
    values = np.random.default_rng(0).integers(0, 256, (2 * CHUNK + 3, 128)).astype(np.uint8)
    one_by_one = [tree.quantise(values[k : k + 1])[0] for k in range(len(values))]
    np.testing.assert_array_equal(tree.quantise(values), one_by_one)


def test_levels_are_clamped_to_the_tree(tree: VocabularyTree) -> None:
    assert [tree.clamped(level) for level in (-1, 1, 7)] == [0, 1, 2]


def test_words_are_the_leaves(tree: VocabularyTree) -> None:
    assert tree.words == 3


def test_arrays_give_the_tree_back(tree: VocabularyTree) -> None:
    again = VocabularyTree(**tree.to_arrays(), space=SPACE)
    for name, array in tree.to_arrays().items():
        np.testing.assert_array_equal(array, again.to_arrays()[name])
