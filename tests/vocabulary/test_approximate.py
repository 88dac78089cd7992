import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vnav.config import VocabularyConfig
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.tree import VocabularyTree
from vnav.errors import ConfigError
from vnav.features.sift import SPACE
from vnav.vocabulary import train
from vnav.vocabulary.approximate import MEMBERS

CONFIG = VocabularyConfig(method="approximate", words=60, max_levels=3)
NOISE = 3


@pytest.fixture(scope="module")
def clusters() -> np.ndarray:
    """20 descriptors about each of 60 centres that lie much farther apart than the noise."""
    rng = np.random.default_rng(0)
    values = rng.integers(20, 236, (60, 1, 128)) + rng.normal(0, NOISE, (60, 20, 128))
    return np.clip(values, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def tree(clusters: np.ndarray) -> VocabularyTree:
    return train(clusters.reshape(-1, 128), SPACE, CONFIG, 0)


def test_words_are_the_leaves_of_the_deepest_level(tree: VocabularyTree) -> None:
    """The cube root of 60 words is 3.9: levels of 1, 4, 15 and up to 60 nodes."""
    assert tree.levels == 3
    assert (tree.level[tree.children == 0] == 3).all()
    sizes = np.bincount(tree.level)
    assert sizes[0] == 1
    assert (sizes <= [1, 4, 15, 60]).all()
    assert tree.words > 40


def test_every_node_but_the_root_has_one_parent_a_level_above(tree: VocabularyTree) -> None:
    inner = np.flatnonzero(tree.children)
    child = [tree.first_child[n] + np.arange(tree.children[n]) for n in inner]
    parent = np.repeat(inner, tree.children[inner])
    child = np.concatenate(child)
    assert sorted(child.tolist()) == list(range(1, len(tree.level)))
    assert (tree.level[child] == tree.level[parent] + 1).all()


def test_the_children_of_a_node_are_those_nearest_to_it(tree: VocabularyTree) -> None:
    centres = tree.centres.astype(float)
    for level in (1, 2):
        nodes, below = np.flatnonzero(tree.level == level), np.flatnonzero(tree.level == level + 1)
        distances = np.linalg.norm(centres[below, None] - centres[nodes], axis=2)
        parent = np.repeat(nodes, tree.children[nodes])
        assert (nodes[distances.argmin(1)] == parent).mean() > 0.95


def test_a_word_is_the_nearest_centre_and_its_path_leads_there(
    tree: VocabularyTree, clusters: np.ndarray
) -> None:
    values = clusters.reshape(-1, 128)
    paths = tree.quantise(values)
    leaves = np.flatnonzero(tree.children == 0)
    centres = tree.centres[leaves].astype(float)
    nearest = leaves[np.linalg.norm(values[:, None] - centres, axis=2).argmin(1)]
    assert (paths[:, -1] == nearest).mean() > 0.97
    for level in range(tree.levels):
        first, count = tree.first_child[paths[:, level]], tree.children[paths[:, level]]
        assert ((paths[:, level + 1] >= first) & (paths[:, level + 1] < first + count)).all()


def test_what_belongs_together_mostly_shares_a_word(
    tree: VocabularyTree, clusters: np.ndarray
) -> None:
    words = [tree.quantise(cluster)[:, -1] for cluster in clusters]
    largest = [np.unique(word, return_counts=True)[1].max() / len(word) for word in words]
    assert np.mean(largest) > 0.9


def test_a_word_has_enough_descriptors_on_the_average(clusters: np.ndarray) -> None:
    few = clusters.reshape(-1, 128)[: 10 * MEMBERS]
    assert train(few, SPACE, CONFIG, 0).words <= 10


@pytest.mark.parametrize("count", [0, 1, 2 * MEMBERS - 1])
def test_too_few_descriptors_for_two_words_give_one(count: int) -> None:
    tree = train(np.zeros((count, 128), np.uint8), SPACE, CONFIG, 0)
    assert (tree.words, tree.levels) == (1, 0)


def test_equal_descriptors_share_a_word() -> None:
    same = np.full((200, 128), 9, np.uint8)
    words = train(same, SPACE, CONFIG, 0).quantise(same)[:, -1]
    assert len(np.unique(words)) == 1


def test_floats_are_clustered_as_bytes_are() -> None:
    space = DescriptorSpace("floats", "float32", 4, "l2", 1.0)
    values = np.random.default_rng(0).random((400, 4)).astype(np.float32)
    tree = train(values, space, CONFIG, 0)
    assert tree.words > 15
    assert tree.centres.dtype == np.float32


def test_bits_are_refused() -> None:
    bits = DescriptorSpace("orb", "uint8", 32, "hamming", 100.0)
    with pytest.raises(
        ConfigError, match=r"vocabulary\.method=hierarchical .*features\.front_end=orb"
    ):
        train(bits.none(), bits, CONFIG, 0)


def test_the_same_seed_gives_the_same_tree_whatever_opencv_drew_before(
    tree: VocabularyTree, clusters: np.ndarray
) -> None:
    again = train(clusters.reshape(-1, 128), SPACE, CONFIG, 0).to_arrays()
    for name, array in tree.to_arrays().items():
        np.testing.assert_array_equal(array, again[name])


def test_another_seed_gives_another_tree(tree: VocabularyTree, clusters: np.ndarray) -> None:
    other = train(clusters.reshape(-1, 128), SPACE, CONFIG, 1)
    assert not np.array_equal(other.centres[:5], tree.centres[:5])


def test_the_number_of_threads_does_not_matter(tmp_path: Path) -> None:
    script = tmp_path / "train.py"
    script.write_text(
        "import os, sys, numpy as np\n"
        "os.cpu_count = lambda: int(sys.argv[2])\n"
        "from vnav.config import VocabularyConfig\n"
        "from vnav.features.sift import SPACE\n"
        "from vnav.vocabulary import approximate, train\n"
        "approximate.BATCH = 700\n"
        "values = np.random.default_rng(0).integers(0, 256, (3000, 128)).astype(np.uint8)\n"
        "config = VocabularyConfig(method='approximate')\n"
        "np.savez(sys.argv[1], **train(values, SPACE, config, 0).to_arrays())\n"
    )
    trees = []
    for threads in (1, 4):
        path = tmp_path / f"{threads}.npz"
        limits = {"OMP_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": str(threads)}
        command = [sys.executable, script, path, str(threads)]
        subprocess.run(command, env=os.environ | limits, check=True)
        trees.append(path.read_bytes())
    assert trees[0] == trees[1]
