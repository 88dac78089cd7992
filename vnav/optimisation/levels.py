"""Systems of cameras that are linked with few others each: block-tridiagonal, level by level.

Cameras at one distance in links from an end of a walk are a level. Links join neighbouring levels
only, so the matrix has blocks on and beside its diagonal; George and Liu 1981, chapter 4.
"""

import numpy as np
from scipy.linalg import cho_solve, cholesky
from scipy.linalg.lapack import dpotri
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from vnav.core.arrays import Array, Rows

LEAST_PIVOT = 1e-12  # of the diagonal's value: less is rounding, and nothing determines it


class Levels:
    """Where the block (6, 6) of two cameras lies in the values of a system.

    ``level``, ``place`` (K,): of a camera, and its place there; ``size`` (N,): cameras of a level;
    ``on``, ``beside`` (N,): where the values of a level begin, and of it with the next one.
    """

    def __init__(self, linked: csr_array) -> None:
        self.level = _distances(linked)
        self.members = [np.flatnonzero(self.level == n) for n in range(self.level.max() + 1)]
        self.place, self.size = np.zeros_like(self.level), np.array([len(m) for m in self.members])
        for members in self.members:
            self.place[members] = np.arange(len(members))
        following = np.append(self.size[1:], 0)
        ends = np.cumsum(36 * self.size * np.stack([self.size, following]), 1)
        self.count = int(ends[:, -1].sum())
        self.on = np.append(0, ends[0, :-1])
        self.beside = ends[0, -1] + np.append(0, ends[1, :-1])

    @property
    def layout(self) -> tuple[Rows, Rows, Rows, Rows, Rows]:
        """What tells compiled code where blocks are."""
        return self.level, self.place, self.size, self.on, self.beside

    def on_diagonal(self, values: Array, n: int) -> Array:
        """The block of a level, of which the lower triangle is filled."""
        size = 6 * self.size[n]
        return values[self.on[n] :][: size * size].reshape(size, size)

    def beside_diagonal(self, values: Array, n: int) -> Array:
        """The block of a level with the next one."""
        shape = 6 * self.size[n], 6 * self.size[n + 1]
        return values[self.beside[n] :][: shape[0] * shape[1]].reshape(shape)


class CameraSystem:
    """A positive definite system, factorised in place; LinAlgError where it is none.

    ``determined``: whether no direction is left to rounding.
    """

    def __init__(self, levels: Levels, values: Array) -> None:
        self._members, self._factors = levels.members, list[Array]()
        self._reach = list[Array]()  # how the solution of a level hangs on that of the next
        self.determined, last = True, len(levels.members) - 1
        for n in range(last + 1):
            block = levels.on_diagonal(values, n)
            expected = block.diagonal().copy()
            if n:
                block -= levels.beside_diagonal(values, n - 1).T @ self._reach[-1]
            factor = cholesky(block.T, overwrite_a=True, check_finite=False)
            self.determined &= bool((factor.diagonal() ** 2 > LEAST_PIVOT * expected).all())
            self._factors.append(factor)
            if n < last:
                self._reach.append(_solved(factor, levels.beside_diagonal(values, n)))

    def solve(self, right: Array) -> Array:
        """Solutions (K, 6, R) of right sides (K, 6, R)."""
        sides = [right[m].reshape(6 * len(m), -1) for m in self._members]
        for n, reach in enumerate(self._reach):
            sides[n + 1] -= reach.T @ sides[n]
        for n in reversed(range(len(sides))):
            sides[n] = _solved(self._factors[n], sides[n])
            if n < len(self._reach):
                sides[n] -= self._reach[n] @ sides[n + 1]
        found = np.zeros_like(right)
        for members, side in zip(self._members, sides, strict=True):
            found[members] = side.reshape(len(members), 6, -1)
        return found

    def covariance(self) -> Array:
        """Of each camera (K, 6, 6): the blocks on the diagonal of the inverse."""
        found = np.zeros((sum(map(len, self._members)), 6, 6))
        inverse = np.zeros((0, 0))
        for n in reversed(range(len(self._members))):
            reach = self._reach[n] if n < len(self._reach) else np.zeros((len(self._factors[n]), 0))
            inverse = _inverse(self._factors[n]) + reach @ inverse @ reach.T
            rows = np.arange(len(inverse)).reshape(-1, 6)
            found[self._members[n]] = inverse[rows[:, :, None], rows[:, None, :]]
        return found


def _solved(factor: Array, right: Array) -> Array:
    return np.asarray(cho_solve((factor, False), right, check_finite=False))


def _inverse(factor: Array) -> Array:
    """The inverse, by its Cholesky factor."""
    upper, _ = dpotri(factor)
    return np.asarray(np.triu(upper) + np.triu(upper, 1).T)


def _distances(linked: csr_array) -> Rows:
    """Levels (K,) of cameras, by their links (K, K); those that nothing joins follow others."""
    level = np.full(linked.shape[0], -1)
    while (level < 0).any():
        end = int(np.argmin(level))
        for _ in range(2):  # from any to one end, from there to the other
            away = dijkstra(linked, unweighted=True, indices=end)
            end = int(np.argmax(np.where(np.isfinite(away), away, -1)))
        reached = np.isfinite(away)
        level[reached] = level.max() + 1 + away[reached].astype(np.intp)
    return level
