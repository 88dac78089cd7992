"""When depth is measured, where poses are known from elsewhere.

Where a camera turns, late depth shows surfaces beside where they are. Odometry's own poses go along
with that; poses from motion capture do not. Views of one place fit best by the true delay.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.reduced_frame import ReducedFrame
from vnav.masking.free_space import misfit
from vnav.masking.view import PosedView

APART_S = 0.5  # two views that are compared: they turn differently, and see one place
MIN_PAIRS, MOST_PAIRS = 6, 24
EXACT = 1e-6  # per metre: no sensor fits better
CLEAR = 3.0  # standard errors by which a delay must fit better than none


@dataclass(frozen=True)
class DepthDelay:
    """How much later than colour depth is measured: ``seconds``, and what its own stamp says.

    Negative where depth is early. Stamps count where they are ``stamped``.
    """

    seconds: float = 0.0
    stamped: bool = False

    def of(self, depth_after_s: float) -> float:
        """Of a frame by the stamp of its depth after that of colour."""
        return self.seconds + self.stamped * depth_after_s


STEPS_S = 0.005 * np.arange(-12, 13)  # a step moves half a block at 50 degrees a second
NONE = DepthDelay()
DELAYS = [DepthDelay(float(s), stamped) for stamped in (False, True) for s in STEPS_S]


@dataclass(frozen=True)
class TimedFrame:
    """A frame with its twist, the pose of its colour (4, 4), and the stamp of depth after it."""

    image: ReducedFrame
    T_world_camera: Array
    depth_after_s: float

    def T_world_depth(self, delay: DepthDelay) -> Array:
        """Where the camera is when depth is measured (4, 4)."""
        late_s = delay.of(self.depth_after_s)
        return np.asarray(self.T_world_camera @ se3.exp(late_s * self.image.twist))

    def view(self, delay: DepthDelay) -> PosedView:
        """From there, of what stands still."""
        still = np.zeros(self.image.grey.shape, bool)
        return PosedView(self.image, self.T_world_depth(delay), still)


def telling_pairs(twists: Array, stamps_s: Array) -> list[tuple[int, int]]:
    """Rows of two frames, `APART_S` from each other, whose cameras turn most differently.

    By their twists (N, 6), 0 where nothing tells, and times (N,), ascending; each pair as far from
    the others.
    """
    later = np.searchsorted(stamps_s, stamps_s + APART_S)
    is_known = np.append(twists.any(1), False)
    first = np.flatnonzero(is_known[:-1] & is_known[later])
    apart = np.linalg.norm(twists[first, :3] - twists[later[first], :3], axis=1)
    fastest = np.argsort(-apart, kind="stable")[: np.count_nonzero(apart)]
    found: list[tuple[int, int]] = []
    for i in first[fastest].tolist():
        if all(abs(stamps_s[i] - stamps_s[k]) >= APART_S for k, _ in found):
            found.append((i, int(later[i])))
    return found[:MOST_PAIRS]


def depth_delay(
    pairs: Iterable[tuple[TimedFrame, TimedFrame]], sigma_per_m2: float, margin_m: float
) -> DepthDelay:
    """The delay by which the surfaces of pairs fit best, none where it does not fit clearly better.

    Nor by few pairs. ``sigma_per_m2`` and ``margin_m`` as `misfit` takes them.
    """
    found = []
    for a, b in pairs:
        misfits = np.array([misfit(a.view(d), b.view(d), sigma_per_m2, margin_m) for d in DELAYS])
        fits = np.isfinite(misfits)
        if fits.any():
            # by a delay by which hardly anything fits, it is largest
            found.append(np.log(np.clip(misfits, EXACT, misfits[fits].max())))
    if len(found) < MIN_PAIRS:
        return NONE
    of_pairs = np.array(found)
    best = int(of_pairs.sum(0).argmin())
    gained = of_pairs[:, DELAYS.index(NONE)] - of_pairs[:, best]
    is_clear = gained.mean() > CLEAR * gained.std() / np.sqrt(len(gained))
    return DELAYS[best] if is_clear else NONE
