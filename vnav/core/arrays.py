"""Names of the commonest arrays, and read-only ones for frozen values."""

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Rows = NDArray[np.intp]
Item = TypeVar("Item")


def frozen(values: ArrayLike, dtype: DTypeLike, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """A read-only array of the given type and shape (None: any length); ValueError otherwise."""
    array = np.asarray(values, dtype)
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        raise ValueError(f"expected an array of shape {shape}, found {array.shape}")
    if array.flags.writeable:
        array = array.view()
        array.flags.writeable = False
    return array


def evenly(items: Sequence[Item], most: int) -> list[Item]:
    """At most so many of the items, evenly from first to last."""
    count = min(most, len(items))
    return [items[n] for n in np.linspace(0, len(items) - 1, count).astype(int).tolist()]
