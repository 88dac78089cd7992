"""Systems of cameras in levels, held against numpy's dense ones: equal but for rounding."""

import numpy as np
import pytest
from numpy.linalg import LinAlgError
from scipy.sparse import csr_array

from vnav.optimisation.elimination import put
from vnav.optimisation.levels import CameraSystem, Levels

Links = list[tuple[int, int]]
WALK: Links = [(k, k + step) for step in (1, 2) for k in range(12 - step)]
SYSTEMS = {
    "a walk": (12, WALK),
    "a walk that closes": (12, [*WALK, (11, 0)]),
    "all see all": (5, [(i, j) for i in range(5) for j in range(i)]),
    "two parts and a camera alone": (9, [(0, 3), (3, 6), (1, 4), (4, 7), (7, 8), (2, 5)]),
}


def levels_of(count: int, links: Links) -> Levels:
    linked = np.zeros((count, count))
    for i, j in links:
        linked[i, j] = linked[j, i] = 1
    return Levels(csr_array(linked))


def dense_of(count: int, links: Links) -> np.ndarray:
    """Blocks (K, K, 6, 6) of random links between cameras that are each held by 1."""
    rng, blocks = np.random.default_rng(0), np.zeros((count, count, 6, 6))
    blocks[range(count), range(count)] = np.eye(6)
    for i, j in links:
        J = {i: rng.standard_normal((6, 6)), j: rng.standard_normal((6, 6))}
        for a in J:
            for b in J:
                blocks[a, b] += J[a].T @ J[b]
    return blocks


def in_levels(levels: Levels, blocks: np.ndarray) -> CameraSystem:
    i, j = np.indices(blocks.shape[:2]).reshape(2, -1)
    values = np.zeros(levels.count)
    put(values, *levels.layout, i, j, blocks.reshape(-1, 6, 6))
    return CameraSystem(levels, values)


@pytest.mark.parametrize("name", SYSTEMS)
def test_solutions_and_covariances_are_those_of_the_whole_matrix(name: str) -> None:
    count, links = SYSTEMS[name]
    blocks = dense_of(count, links)
    found = in_levels(levels_of(count, links), blocks)
    whole = blocks.swapaxes(1, 2).reshape(6 * count, 6 * count)
    right = np.random.default_rng(1).standard_normal((count, 6, 2))
    solution = np.linalg.solve(whole, right.reshape(6 * count, 2)).reshape(count, 6, 2)
    np.testing.assert_allclose(found.solve(right), solution, atol=1e-10)
    inverse = np.linalg.inv(whole).reshape(count, 6, count, 6)
    expected = inverse[range(count), :, range(count), :]
    np.testing.assert_allclose(found.covariance(), expected, atol=1e-10)
    assert found.determined


def test_a_long_walk_takes_room_for_its_links_only() -> None:
    walk = [(k, k + step) for step in (1, 2) for k in range(400 - step)]
    assert levels_of(400, walk).count < 400 * 6 * 36


def test_links_join_levels_side_by_side_only() -> None:
    levels = levels_of(*SYSTEMS["a walk that closes"])
    i, j = np.array(SYSTEMS["a walk that closes"][1]).T
    assert np.abs(levels.level[i] - levels.level[j]).max() == 1


def test_what_only_rounding_determines_is_told() -> None:
    blocks = dense_of(2, [(0, 1)])
    blocks[range(2), range(2)] -= np.eye(6) * (1 - 1e-15)
    assert not in_levels(levels_of(2, [(0, 1)]), blocks).determined


def test_what_is_not_positive_definite_is_refused() -> None:
    with pytest.raises(LinAlgError):
        in_levels(levels_of(1, []), -np.eye(6)[None, None])
