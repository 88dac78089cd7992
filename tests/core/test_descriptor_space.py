"""Descriptors of bytes, floats and bits: distances and means are those of the definition."""

import numpy as np
import pytest

from vnav.compiled import compiled
from vnav.compiled.descriptors import squared_distance
from vnav.core.descriptor_space import DescriptorSpace

BYTES = DescriptorSpace("bytes", "uint8", 128, "l2", 512.0)
FLOATS = DescriptorSpace("floats", "float32", 64, "l2", 1.0)
BITS = DescriptorSpace("bits", "uint8", 32, "hamming", 110.0)
SPACES = (BYTES, FLOATS, BITS)
RNG = np.random.default_rng(0)


def drawn(space: DescriptorSpace, count: int) -> np.ndarray:
    values = RNG.integers(0, 256, (count, space.width))
    return (values / 256 if space is FLOATS else values).astype(space.dtype)


def defined(space: DescriptorSpace, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distances (A, B) by the definition of the metric."""
    if space is BITS:
        differing = np.bitwise_xor(a[:, None], b[None])
        return np.array(
            [[sum(int(v).bit_count() for v in pair) for pair in row] for row in differing]
        )
    return np.linalg.norm(a[:, None].astype(float) - b[None].astype(float), axis=2)


@compiled
def _all_squared(a, b):  # type: ignore[no-untyped-def]
    out = np.empty((len(a), len(b)))
    for i in range(len(a)):
        for j in range(len(b)):
            out[i, j] = squared_distance(a[i], b[j])
    return out


@pytest.mark.parametrize("space", SPACES, ids=lambda s: s.front_end)
def test_vectors_and_compiled_loops_have_the_distances_of_the_definition(
    space: DescriptorSpace,
) -> None:
    a, b = drawn(space, 7), drawn(space, 9)
    wanted = defined(space, a, b)
    u, v = space.vectors(a), space.vectors(b)
    of_vectors = ((u[:, None] - v[None]) ** 2).sum(2)
    compiled_ones = _all_squared(space.comparable(a), space.comparable(b)).astype(np.float32)
    for squared in (of_vectors, compiled_ones):
        np.testing.assert_allclose(space.distance(squared), wanted, rtol=1e-5)
    assert space.squared(float(wanted[0, 0])) == pytest.approx(float(of_vectors[0, 0]), rel=1e-5)


@pytest.mark.parametrize("space", SPACES, ids=lambda s: s.front_end)
def test_the_nearest_descriptor_of_a_vector_is_itself(space: DescriptorSpace) -> None:
    a = drawn(space, 5)
    again = space.nearest(space.vectors(a))
    assert again.dtype == space.dtype
    np.testing.assert_array_equal(again, a)


def test_the_mean_of_bits_is_their_majority() -> None:
    right = drawn(BITS, 1)
    few = np.repeat(right, 3, 0)
    few[1, 4] ^= 0b100  # one of three is of another opinion
    np.testing.assert_array_equal(BITS.nearest(BITS.vectors(few).mean(0, keepdims=True)), right)


def test_a_ratio_of_bits_is_taken_of_their_number() -> None:
    assert BITS.squared(0.8) == 0.8
    assert BYTES.squared(0.8) == pytest.approx(0.64)


@pytest.mark.parametrize(
    ("dtype", "width", "metric"),
    [("int8", 8, "l2"), ("uint8", 8, "cosine"), ("float32", 8, "hamming"), ("uint8", 5, "hamming")],
)
def test_a_space_that_nothing_can_compare_is_refused(dtype: str, width: int, metric: str) -> None:
    with pytest.raises(ValueError, match="expected"):
        DescriptorSpace("none", dtype, width, metric, 1.0)
