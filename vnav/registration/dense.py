"""Two frames, all their pixels, to the motion between them: for frames with too few features.

Points of one are held against the surface and the brightness that the other has measured where they
fall, from coarse to fine. Source: Kerl, Sturm, Cremers 2013, "Dense visual SLAM for RGB-D cameras".
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame, Rejected
from vnav.core.reduced_frame import ReducedFrame
from vnav.registration.image_pair import ImagePair
from vnav.registration.judge import CLEAR
from vnav.registration.refinement import CONVERGED
from vnav.registration.residual_term import ResidualTerm

MOTION_SIGMAS = np.repeat([np.deg2rad(3.0), 0.05], 3)  # rad, m: of a predicted motion
MAX_SIGMAS = 3.0  # of it, that the motion found may be off the prediction
BLURS_PX = (12.0, 6.0, 3.0, 1.5)  # of the images that are compared, from coarse to fine
BLURS_BLOCKS = (3.0, 1.5)  # of frames in blocks
ITERATIONS = 20  # at each of them
MIN_OVERLAP = 0.4  # share of the points that fall on a surface of the other image
MIN_SURFACE = 0.1  # the same, of surfaces alone
SAME_SURFACE_SIGMAS = 6.0  # of inverse depth, that a point may lie off the surface it is of
MIN_INLIERS = 0.8  # share of those that lie on it
WELL_CONSTRAINED = 100.0  # times the prediction's information, in every direction

Terms = Sequence[ResidualTerm]


@dataclass(frozen=True)
class DenseEstimate:
    """How camera b stands to a, from all pixels and a prediction; ``information`` as in `Edge`.

    ``well_constrained``: the images fix every direction, and the prediction decides none;
    ``probability`` as in `Edge`.
    """

    T_a_b: Array
    information: Array
    well_constrained: bool
    probability: float = 1.0


def align(
    a: Frame, b: Frame, intrinsics: Intrinsics, config: RegistrationConfig, predicted: Array
) -> DenseEstimate | Rejected:
    """How camera b stands to camera a by the surfaces and the brightness that both have seen.

    Gauss-Newton from the predicted ``T_a_b``, from coarse images to fine ones, under Cauchy's
    kernel, which is as wide as the residuals are and narrows with them. The directions that they
    know least, as a bare wall along itself, are sought from either side. Where one is open all the
    same, the prediction decides, and the information says how little it knows. Rejected where too
    little overlaps or agrees, or where the prediction is contradicted.
    """
    return _aligned(ImagePair.of(a, b, intrinsics), BLURS_PX, config, predicted)


def align_reduced(
    a: ReducedFrame, b: ReducedFrame, config: RegistrationConfig, predicted: Array
) -> DenseEstimate | Rejected:
    """The same of frames in blocks, a fraction of the work."""
    return _aligned(ImagePair.of_blocks(a, b), BLURS_BLOCKS, config, predicted)


def align_near(
    a: ReducedFrame, b: ReducedFrame, config: RegistrationConfig, predicted: Array
) -> DenseEstimate | Rejected:
    """The same, a fifth of its work, where others judge it: what lies beside is not sought."""
    levels, T_a_b = _fitted(ImagePair.of_blocks(a, b), BLURS_BLOCKS, config, predicted)
    return _estimate(levels[-1], T_a_b, predicted, MIN_OVERLAP)


def fitted_near(
    a: ReducedFrame, b: ReducedFrame, config: RegistrationConfig, predicted: Array
) -> Array:
    """The ``T_a_b`` that fits two frames in blocks best near a predicted one; others must judge it.

    Unlike `align_near` it asks neither how much overlaps nor how much agrees.
    """
    return _fitted(ImagePair.of_blocks(a, b), BLURS_BLOCKS, config, predicted)[1]


def align_surfaces(
    a: ReducedFrame, b: ReducedFrame, config: RegistrationConfig, predicted: Array
) -> DenseEstimate | Rejected:
    """How camera b stands to a by their surfaces alone, near to a prediction that is nearly right.

    For views from two sides, whose brightness differs. A surface that is far from the other by the
    prediction is another one, which hides it or is hidden.
    """
    images, sigma = ImagePair.of_blocks(a, b), config.depth_sigma_per_m2
    term = images.surface_term(BLURS_BLOCKS[-1], sigma).near(predicted, SAME_SURFACE_SIGMAS)
    T_a_b = _minimised([term], predicted, predicted)
    return _estimate([term], T_a_b, predicted, MIN_SURFACE)


def _aligned(
    images: ImagePair, blurs_px: Sequence[float], config: RegistrationConfig, predicted: Array
) -> DenseEstimate | Rejected:
    levels, T_a_b = _fitted(images, blurs_px, config, predicted)
    T_a_b = _from_all_sides(levels, T_a_b, predicted)
    return _estimate(levels[-1], T_a_b, predicted, MIN_OVERLAP)


def _fitted(
    images: ImagePair, blurs_px: Sequence[float], config: RegistrationConfig, predicted: Array
) -> tuple[Sequence[Terms], Array]:
    """What images blurred by so much compare, and the motion that it leads to."""
    levels = [images.terms(blur_px, config.depth_sigma_per_m2) for blur_px in blurs_px]
    return levels, _coarse_to_fine(levels, se3.orthonormal(predicted), predicted)


def _estimate(
    terms: Terms, T_a_b: Array, predicted: Array, min_overlap: float
) -> DenseEstimate | Rejected:
    """A motion with what the images tell of it, where enough of their surfaces agree."""
    known, axes, _ = _image_information(terms, T_a_b)
    overlap, agreeing = terms[0].agreement(T_a_b)
    if overlap < min_overlap:
        return Rejected("too little depth in common")
    if agreeing < MIN_INLIERS:
        return Rejected("surfaces do not agree")
    if np.abs(_deviation(T_a_b, predicted)).max() > MAX_SIGMAS:
        return Rejected("surfaces contradict the prediction")
    information = (axes * (known + 1)) @ axes.T / np.outer(MOTION_SIGMAS, MOTION_SIGMAS)
    return DenseEstimate(T_a_b, information, bool(known.min() > WELL_CONSTRAINED))


def _coarse_to_fine(levels: Sequence[Terms], T_a_b: Array, predicted: Array) -> Array:
    for terms in levels:
        T_a_b = _minimised(terms, T_a_b, predicted)
    return T_a_b


def _from_all_sides(levels: Sequence[Terms], T_a_b: Array, predicted: Array) -> Array:
    """The motion that is found from beside ``T_a_b``, where the images know least, if it is better.

    What stands out of a wall draws surfaces back only from where they overlap its slopes, and the
    bars of a window have a minimum beside the least one.
    """
    known, axes, _ = _image_information(levels[-1], T_a_b)
    steps = np.array([side * d for d in _directions(known, axes) for side in (-1, 1)])
    beside = [T_a_b @ se3.exp(step * MOTION_SIGMAS) for step in steps]
    found = [T_a_b]
    for start in beside:
        T = _coarse_to_fine(levels, start, start)  # the prediction would draw it back at once
        found.append(_minimised(levels[-1], T, predicted))
    costs = [_cost(levels[-1], T, predicted) for T in found]
    best = int(np.argmin(costs))
    chosen = found[best] if costs[0] - costs[best] > CLEAR else T_a_b
    for term in levels[-1]:
        term.adapt(chosen)
    return chosen


def _directions(known: Array, axes: Array) -> Array:
    """Unit steps (D, 6) along which the images know little, or the one that they know least.

    A wall leaves three directions open, and which axes span these is chance. The motions that lie
    mostly in that space are not, such as those along the camera's own axes.
    """
    little = axes[:, known <= max(WELL_CONSTRAINED, known.min())]
    along = little @ little.T
    share = np.diag(along)
    mostly = share >= min(0.5, share.max())
    return np.asarray(along[mostly] / np.sqrt(share[mostly])[:, None])


def _cost(terms: Terms, T_a_b: Array, predicted: Array) -> float:
    """Negative logarithm of a motion's likelihood, up to a constant."""
    for term in terms:
        term.adapt(T_a_b)
    off = _deviation(T_a_b, predicted)
    return sum(term.cost(T_a_b) for term in terms) + float(off @ off) / 2


def _minimised(terms: Terms, T_a_b: Array, predicted: Array) -> Array:
    """The motion of least cost near ``T_a_b``, in open directions that which was predicted."""
    for _ in range(ITERATIONS):
        for term in terms:
            term.adapt(T_a_b)
        known, axes, gradient = _image_information(terms, T_a_b)
        gradient += axes.T @ _deviation(T_a_b, predicted)
        step = -MOTION_SIGMAS * (axes @ (gradient / (known + 1)))
        T_a_b = T_a_b @ se3.exp(step)
        if np.abs(step).max() < CONVERGED:
            break
    return T_a_b


def _image_information(terms: Terms, T_a_b: Array) -> tuple[Array, Array, Array]:
    """What the images tell (6,), in units of the prediction's information; its axes; the gradient.

    The axes (6, 6) are columns, and the gradient (6,) is along them. Noise of the image gradients
    seems to tell something too, which is taken off.
    """
    told, apparent, gradient = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6)
    unit = np.outer(MOTION_SIGMAS, MOTION_SIGMAS)
    for term in terms:
        H, H_noise, g = term.normal_equations(T_a_b)
        known, axes = np.linalg.eigh((H - H_noise) * unit)
        told += (axes * np.maximum(known, 0)) @ axes.T
        apparent += H * unit
        gradient += g * MOTION_SIGMAS
    known, axes = np.linalg.eigh(told)
    known = np.maximum(known, 0)
    along = np.einsum("ik,ij,jk->k", axes, apparent, axes)
    return known, axes, known / np.maximum(along, 1e-9) * (axes.T @ gradient)


def _deviation(T_a_b: Array, predicted: Array) -> Array:
    """How far (6,) a motion is off the prediction, in the prediction's standard deviations."""
    return np.asarray(se3.deviation(se3.inverse(predicted) @ T_a_b) / MOTION_SIGMAS)
