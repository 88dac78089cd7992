import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vnav import vocabulary
from vnav.config import VocabularyConfig
from vnav.features.sift import SPACE
from vnav.vocabulary import train

CONFIG = VocabularyConfig(branching=4, max_levels=3, min_leaf=8)


def clusters(rng: np.random.Generator, count: int, size: int) -> np.ndarray:
    """Descriptors about ``count`` centres that lie much farther apart than the noise."""
    centres = rng.integers(20, 236, (count, 1, 128))
    values = centres + rng.normal(0, 3, (count, size, 128))
    return np.clip(values, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def descriptors() -> np.ndarray:
    return clusters(np.random.default_rng(0), 60, 20).reshape(-1, 128)


def test_children_lie_side_by_side_one_level_deeper(descriptors: np.ndarray) -> None:
    tree = train(descriptors, SPACE, CONFIG, 0)
    for node in np.flatnonzero(tree.children):
        children = tree.first_child[node] + np.arange(tree.children[node])
        assert (tree.level[children] == tree.level[node] + 1).all()
    assert tree.children.sum() == len(tree.level) - 1  # every node but the root has one parent


def test_no_node_is_deeper_or_wider_than_asked(descriptors: np.ndarray) -> None:
    tree = train(descriptors, SPACE, CONFIG, 0)
    assert tree.levels <= CONFIG.max_levels
    assert tree.children.max() <= CONFIG.branching


def test_what_belongs_together_mostly_shares_a_word() -> None:
    """Apart by 20 times the noise: only a cluster that k-means happens to cut is torn."""
    values = clusters(np.random.default_rng(1), 60, 30)
    tree = train(values.reshape(-1, 128), SPACE, VocabularyConfig(8, 2, min_leaf=31), 0)
    words = [tree.quantise(cluster)[:, -1] for cluster in values]
    largest = [np.unique(word, return_counts=True)[1].max() / len(word) for word in words]
    assert np.mean(largest) > 0.9


def test_the_same_seed_gives_the_same_tree(descriptors: np.ndarray) -> None:
    one, two = (train(descriptors, SPACE, CONFIG, 7).to_arrays() for _ in range(2))
    for name in one:
        np.testing.assert_array_equal(one[name], two[name])


def test_the_number_of_threads_does_not_matter(tmp_path: Path) -> None:
    script = tmp_path / "train.py"
    script.write_text(
        "import sys, numpy as np\n"
        "from vnav.config import VocabularyConfig\n"
        "from vnav.features.sift import SPACE\n"
        "from vnav.vocabulary import train\n"
        "values = np.random.default_rng(0).integers(0, 256, (3000, 128)).astype(np.uint8)\n"
        "np.savez(sys.argv[1], **train(values, SPACE, VocabularyConfig(), 0).to_arrays())\n"
    )
    one_thread = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    subprocess.run([sys.executable, script, tmp_path / "tree.npz"], env=one_thread, check=True)
    values = np.random.default_rng(0).integers(0, 256, (3000, 128)).astype(np.uint8)
    here = train(
        values, SPACE, VocabularyConfig(), 0
    ).to_arrays()  # as many threads as there are cores
    with np.load(tmp_path / "tree.npz") as there:
        for name, array in here.items():
            np.testing.assert_array_equal(array, there[name])


def test_more_descriptors_than_allowed_are_subsampled(descriptors: np.ndarray) -> None:
    few = VocabularyConfig(branching=4, max_levels=3, max_descriptors=100, min_leaf=8)
    assert train(descriptors, SPACE, few, 0).words < train(descriptors, SPACE, CONFIG, 0).words


def test_nothing_to_train_on_gives_one_word() -> None:
    tree = train(SPACE.none(), SPACE, CONFIG, 0)
    assert (tree.words, tree.levels) == (1, 0)


def test_equal_descriptors_give_one_word() -> None:
    assert train(np.full((50, 128), 9, np.uint8), SPACE, CONFIG, 0).words == 1


def test_fewer_descriptors_than_branches_are_legal() -> None:
    values = np.repeat([[0], [100], [200]], 128, 1).astype(np.uint8)
    assert train(values, SPACE, VocabularyConfig(branching=10, min_leaf=2), 0).words == 3


def test_the_self_test_passes() -> None:
    vocabulary.self_test()


def test_quantising_needs_no_sklearn() -> None:
    code = (
        "import sys, numpy as np; from vnav.core.tree import VocabularyTree as T;"
        "from vnav.features.sift import SPACE;"
        "z = np.zeros(1, np.int32);"
        "T(np.zeros((1, 128), np.uint8), z, z, z, SPACE).quantise(np.zeros((2, 128), np.uint8));"
        "assert 'sklearn' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
