"""The offset of a depth sensor's inverse depths, found by bundle adjustment."""

import dataclasses

from vnav.optimisation.bundle import adjust
from vnav.optimisation.bundle_graph import BundleProblem
from vnav.optimisation.sensor_model import Bundle

OFFSET_SIGMA = 2e-4  # 1/m of inverse depth, 3 mm at 4 m: a sensor's prior, and what is tried
LARGEST_OFFSET = 3 * OFFSET_SIGMA
ITERATIONS = 8  # from one bundle for all that are tried, so that their costs compare


def depth_offset(bundle: Bundle, problem: BundleProblem) -> float:
    """What all measured inverse depths (1/m) have too much; 0 where the images contradict it.

    Depth by triangulation, from structured light or stereo, errs by an offset of its disparity.
    That bends what is far against what is near, as no scale would, and landmarks seen from several
    places show it. Taken where the cost of the best bundle, a parabola of the offset, and the
    prior's are least together. A minimum beyond `LARGEST_OFFSET` is not that of an offset: such
    depth errs otherwise. Source: Herrera, Kannala, Heikkila 2012, "Joint depth and color camera
    calibration with distortion correction", whose c0 it is.
    """
    below, at, above = (_cost(bundle, problem, k * OFFSET_SIGMA) for k in (-1, 0, 1))
    of_prior = 1.0
    curvature = max(below - 2 * at + above, 0.0) + of_prior
    offset = OFFSET_SIGMA * (below - above) / (2 * curvature)
    return offset if abs(offset) < LARGEST_OFFSET else 0.0


def _cost(bundle: Bundle, problem: BundleProblem, offset: float) -> float:
    """Cost of the best bundle where inverse depths have such an offset."""
    without = dataclasses.replace(problem, seen=problem.seen.without_offset(offset))
    best = adjust(bundle, without, ITERATIONS, tolerance=0.0)
    return without.model.cost(best, without.seen)
