"""How cells of an image vote between motions, as compiled loops.

A cell's pixels err together, and a thing that moves fills its cells with pixels that all say the
same, so a cell has one vote. A cell that tells nothing, as on a bare wall, goes with the nearest
one that does, along the surface that both lie on: so a wall with few marks weighs as much as it is
large, and not as its marks are many.
"""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array

DECIDED = 0.5  # of the largest vote; a cell with less tells nothing
GROSS = 0.5  # of what the better one says of a pixel; a difference of less counts for less
STEEP = 0.05  # relative change of inverse depth that is as far as the next cell


@compiled
def poll(
    told: Array,
    cells: NDArray[np.int64],
    inverse_depth: Array,
    weight: float,
    wrong: float,
    alone: bool,
    afar: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """Sums of the votes between H hypotheses (H, H), and the variance of these sums.

    ``told`` (H, N): log-likelihood of each pixel under each, over chance, NaN where it says
    nothing; the last is chance itself. ``cells`` (N,): which cell a pixel is in, a number into
    ``inverse_depth`` (R, C), 0 where unknown. A pixel counts ``weight``; a cell is wrong with the
    probability ``wrong``, however sure its pixels are. ``alone``: whether cells vote that say
    something of one of two alone. ``afar`` (H, H): which two have most pixels in other places.
    """
    size, least = len(told), DECIDED * np.log((1 - wrong) / wrong)
    favour, variance = np.zeros((size, size)), np.zeros((size, size))
    sums, seen = _of_each(told, cells, inverse_depth.size, weight)
    for i in range(size):
        for j in range(i):
            apart = _grossly(told[i], told[j]) if afar[i, j] else told[i] - told[j]
            total, known = _totals(apart, cells, inverse_depth.size, weight)
            vote = _votes(total, wrong)
            if alone and i < size - 1:  # chance sees nothing of its own
                _add_seen_by_one(vote, known, sums[i], sums[j], seen[i] != seen[j], wrong)
            speaks = np.abs(vote) >= least
            weighted = vote * _represented(speaks, known, inverse_depth)
            favour[i, j] = weighted.sum()
            variance[i, j] = (weighted**2).sum() * (1 + 1 / max(speaks.sum(), 1))
            favour[j, i], variance[j, i] = -favour[i, j], variance[i, j]
    return favour, variance


@compiled
def _grossly(one: Array, other: Array) -> Array:
    """What pixels (N,) say of one hypothesis more than of another, less where both fit as well.

    What looks alike in two places repeats itself, and lens and light then decide which looks more
    so. Motions that are nearly one have nothing but such small differences.
    """
    apart = one - other
    for n in range(len(apart)):
        if one[n] > 0 and other[n] > 0:
            apart[n] *= min(1.0, abs(apart[n]) / (GROSS * max(one[n], other[n])))
    return apart


@compiled
def _add_seen_by_one(
    vote: Array,
    known: NDArray[np.bool_],
    one: Array,
    other: Array,
    by_one: NDArray[np.bool_],
    wrong: float,
) -> None:
    """Add, in place, the votes of cells that say something of one of two hypotheses alone.

    Only where these are more than those that say something of both: motions far apart see little of
    the same, which may be a thing that moves. What looks alike under both, as what repeats, tells
    nothing of either; so such a cell counts for the share of the others that does not.
    ``one`` and ``other`` (R * C,): what cells say of each; ``by_one``: which say it of one alone.
    """
    if by_one.sum() <= known.sum():
        return
    alike = (known & (one > 0) & (other > 0)).sum() / max(known.sum(), 1)
    vote[by_one] = (1 - alike) * _votes(one - other, wrong)[by_one]
    known |= by_one


@compiled
def _of_each(
    told: Array, cells: NDArray[np.int64], count: int, weight: float
) -> tuple[Array, NDArray[np.bool_]]:
    """What the cells say of each hypothesis (H, count), and of which they say anything."""
    sums, seen = np.zeros((len(told), count)), np.zeros((len(told), count), np.bool_)
    for k in range(len(told)):
        sums[k], seen[k] = _totals(told[k], cells, count, weight)
    return sums, seen


@compiled
def _totals(
    told: Array, cells: NDArray[np.int64], count: int, weight: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Sums over the pixels of each cell, and which cells have any."""
    total, known = np.zeros(count), np.zeros(count, np.bool_)
    for n in range(len(cells)):
        if not np.isnan(told[n]):
            total[cells[n]] += weight * told[n]
            known[cells[n]] = True
    return total, known


@compiled
def _votes(total: Array, wrong: float) -> Array:
    """Log-likelihood ratios of cells, each of which may be wrong."""
    ratio = np.exp(np.minimum(np.maximum(total, -50.0), 50.0))
    return np.log(((1 - wrong) * ratio + wrong) / (1 - wrong + wrong * ratio))


@compiled
def _represented(
    speaks: NDArray[np.bool_], known: NDArray[np.bool_], inverse_depth: Array
) -> Array:
    """For how many of the known cells each (R * C,) speaks: 0 where it does not."""
    speaker, far = np.full(len(speaks), -1), np.full(len(speaks), np.inf)
    for c in range(len(speaks)):
        if known[c] and speaks[c]:
            speaker[c], far[c] = c, 0.0
    changed = True
    while changed:
        changed = False
        for c in range(len(speaks)):
            if known[c] and _hears(c, speaker, far, inverse_depth):
                changed = True
    count = np.zeros(len(speaks))
    for c in range(len(speaks)):
        if speaker[c] >= 0:
            count[speaker[c]] += 1
    return count


@compiled
def _hears(c: int, speaker: NDArray[np.int64], far: Array, inverse_depth: Array) -> bool:
    """Let a cell go with the speaker of a neighbour, in place, if that is the nearest so far."""
    rows, columns = inverse_depth.shape
    changed = False
    for down, across in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        v, u = c // columns + down, c % columns + across
        if not (0 <= v < rows and 0 <= u < columns):
            continue
        n = v * columns + u
        step = far[n] + _step(inverse_depth[v, u], inverse_depth[c // columns, c % columns])
        if step < far[c]:
            far[c], speaker[c], changed = step, speaker[n], True
    return changed


@compiled
def _step(w: float, other: float) -> float:
    """How far it is between neighbouring cells, along the surface or over its edge."""
    return 1 + abs(w - other) / (STEEP * max(w, other, 1e-6))
