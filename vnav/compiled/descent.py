"""The way of descriptors through a vocabulary tree."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.compiled.descriptors import squared_distance


@compiled
def descend(
    descriptors: NDArray[Any],
    centres: NDArray[Any],
    first_child: NDArray[np.int32],
    children: NDArray[np.int32],
    paths: NDArray[np.int32],
) -> None:
    """Fill the nodes (N, levels + 1) below the first: of each the child nearest to a descriptor.

    ``descriptors`` (N, D) and ``centres`` (nodes, D) as `DescriptorSpace.comparable` gives them; a
    leaf repeats itself, and of children equally near the first is taken.
    """
    for n in range(len(paths)):
        for level in range(paths.shape[1] - 1):
            node = paths[n, level]
            nearest = node
            least = np.inf
            for child in range(first_child[node], first_child[node] + children[node]):
                distance = squared_distance(descriptors[n], centres[child])
                if distance < least:
                    least, nearest = distance, child
            paths[n, level + 1] = nearest
