import numpy as np
import pytest

from vnav.core.tree import CHUNK, FINEST, VocabularyTree
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


@pytest.mark.parametrize(
    ("level", "counted_from", "from_root"),
    [(1, "root", 1), (1, "leaves", 1), (0, "leaves", 2), (2, "leaves", 0), (7, "root", 7)],
)
def test_levels_count_from_the_root_or_from_the_deepest_leaves(
    tree: VocabularyTree, level: int, counted_from: str, from_root: int
) -> None:
    assert tree.from_root(level, counted_from) == from_root


@pytest.mark.parametrize("counted_from", ["root", "leaves"])
def test_the_finest_level_is_that_of_the_leaves(tree: VocabularyTree, counted_from: str) -> None:
    assert tree.from_root(FINEST, counted_from) == tree.levels


def test_the_nearest_leaves_are_told_nearest_first(tree: VocabularyTree) -> None:
    """Of 58, node 1 (at 10) is 48 away, node 3 (at 90) 32, node 4 (at 110) 52."""
    assert tree.nearest_leaves(descriptors(58), 3).tolist() == [[3, 1, 4]]


def test_leaves_that_are_not_there_are_no_nodes(tree: VocabularyTree) -> None:
    assert tree.nearest_leaves(descriptors(100), 5).tolist() == [[3, 4, 1, -1, -1]]


def test_of_each_level_only_the_nearest_nodes_are_followed(tree: VocabularyTree) -> None:
    """Of 54, node 1 (at 10) is 44 away and node 2 (at 100) 46: its leaf at 90 is not looked at."""
    assert tree.nearest_leaves(descriptors(54), 1).tolist() == [[1]]
    assert tree.nearest_leaves(descriptors(54), 2).tolist() == [[3, 1]]


def test_a_root_alone_is_the_nearest_leaf() -> None:
    one = np.zeros(1, np.int32)
    root = VocabularyTree(np.zeros((1, 128), np.uint8), one, one, one, SPACE)
    assert root.nearest_leaves(descriptors(5), 2).tolist() == [[0, -1]]
