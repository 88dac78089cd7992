"""A second look at a stretch of odometry that closures contradict: by its keyframes' pixels."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array, evenly
from vnav.core.camera import Intrinsics
from vnav.core.camera_motion import velocities
from vnav.core.frame import Edge, Frame, PoseEstimate, Rejected
from vnav.core.graph import log_odds_of
from vnav.core.jumps import RUSH, jumps
from vnav.core.mapping import LOST, Odometry
from vnav.core.reduced_frame import ReducedFrame
from vnav.core.view_overlap import view_overlap
from vnav.features.matching import DescriptorMatcher
from vnav.optimisation.contradictions import Contradiction
from vnav.optimisation.cycles import are_wrong
from vnav.optimisation.revisits import (
    MIN_OVERLAP,
    Pair,
    Revisits,
    find_revisits,
    surface_edges,
)
from vnav.optimisation.segments import Inside, same_pose
from vnav.registration.dense import align
from vnav.registration.judge import CLEAR, PixelEvidence, judge
from vnav.registration.points3d import PointRegistration
from vnav.registration.reduction import reduced
from vnav.registration.surface_agreement import (
    MIN_SHARED,
    SEEN_THROUGH_SIGMAS,
    USUAL,
    Agreement,
    agreements,
    borne_out_by,
    disagreeing,
    seeing_through,
)

MOST_PAIRS = 60  # of keyframes that are compared, where two parts are to be joined
MOST_THROUGH, MOST_GONE = 0.2, 0.5  # of them that may see through each other: docs/log.md
LEAST_PAIRS, MOST_APART = 5, 0.1  # that tell which of several places is the right one; share
UNLIKE = 0.02  # share of blocks that show something else, beyond what is usual
DRIFTED_SIGMAS = 24.0  # from which a surface is seen through, 0.13 m at 2 m: drift is left
KEPT_IMAGES = 120  # of keyframes, reduced: about 60 MB
Views = Callable[[int], Frame]  # the images of a keyframe, by its row


@dataclass(frozen=True)
class Correction:
    """What replaces odometry across a stretch that closures contradict: an edge, or nothing."""

    stretch: Contradiction
    edge: Edge | None


class SecondLook:
    """Keyframes registered and judged anew, by what a map has stored of them."""

    def __init__(
        self, odometry: Odometry, cameras: Sequence[Intrinsics], views: Views, config: Config
    ) -> None:
        """``cameras``: one a capture; ``views``: the images of a keyframe, by its row."""
        self._odometry, self._cameras, self._views = odometry, cameras, views
        self._keyframes = {k.row: k for k in odometry.keyframes}
        self._matcher, self._config = DescriptorMatcher(config.registration), config
        self._moving = lru_cache(KEPT_IMAGES)(self._reduced_at)

    def correct(self, stretch: Contradiction, T_i_j: Array) -> Correction | None:
        """What odometry's motion ``T_i_j`` across a stretch is to be replaced by; None: it stays.

        An edge near the motion that closures imply, where the pixels bear it out and odometry not;
        nothing where these cannot tell the two. What the pixels of the frames between said of
        odometry's edges counts, too: where the keyframes show no other motion, it decides alone.
        However many closures there are, pixels that bear odometry out keep it: closures that are
        wrong together have one common cause. A motion that no camera makes is hardly likely.
        """
        edge, before = self._other_motion(stretch), self._log_odds_before(stretch)
        if edge is None:
            return Correction(stretch, None) if before < 0 else None
        if not are_wrong(se3.inverse(T_i_j) @ edge.T_i_j):
            return None
        log_odds = self.log_odds(stretch.i, stretch.j, [T_i_j, edge.T_i_j])
        if not _is_near(edge, stretch) or log_odds[1, -1] < CLEAR:
            return Correction(stretch, None) if before < 0 or log_odds[0, -1] < -CLEAR else None
        in_favour = log_odds[0, 1] + before + self._log_odds_of_steps(stretch, [T_i_j, edge.T_i_j])
        if in_favour > CLEAR:
            return None
        return Correction(stretch, edge if in_favour < -CLEAR else None)

    def is_borne_out(
        self, poses: Array, a: Inside, b: Inside, most_through: float = MOST_THROUGH
    ) -> bool:
        """Whether two sets of frames (N,) may share a place as poses (N, 4, 4) have them.

        At most such a share of the pairs of keyframes across may see through what the other sees.
        Where a chair was moved between two recordings some do, where people left more, and where a
        place is taken for another half of them.
        Nor may the camera leap from one set to the other, by more than drift may have moved either:
        what repeats is seen through nowhere.
        """
        leaps = (se3.inverse(poses[i]) @ poses[j] for i, j in self._leaps(poses, a, b))
        if not all(map(same_pose, leaps)):
            return False
        pairs, neighbours = self._across(poses, a, b, MIN_SHARED, DRIFTED_SIGMAS)
        return len(seeing_through(pairs, neighbours)) <= most_through * len(pairs)

    def is_sure(self, poses: Array, a: Inside, b: Inside) -> bool:
        """Whether two sets of frames (N,) share a place, though others look like it.

        By poses (N, 4, 4) nearly all pairs of keyframes across agree, and there are enough of them.
        """
        pairs, neighbours = self._across(poses, a, b, MIN_OVERLAP, SEEN_THROUGH_SIGMAS)
        is_borne_out = borne_out_by(poses, self._moving, self._config.registration)
        apart = disagreeing(pairs, neighbours, is_borne_out)
        return len(pairs) >= LEAST_PAIRS and len(apart) <= MOST_APART * len(pairs)

    def unlike(self, poses: Array, a: Inside, b: Inside) -> float:
        """Share of pairs of keyframes of two sets of frames (N,) that show different things.

        Equal shelves, by poses (N, 4, 4), differ in a few things: more blocks show something else
        there than those of neighbours usually do.
        """
        pairs, neighbours = (
            [self._refuting(i, j, se3.inverse(poses[i]) @ poses[j]) for i, j in of_kind]
            for of_kind in self._overlapping(poses, a, b, MIN_OVERLAP)
        )
        most = UNLIKE + (np.quantile(neighbours, USUAL) if neighbours else 0.0)
        return float(np.mean(np.array(pairs) > most)) if pairs else 0.0

    def _refuting(self, i: int, j: int, T_i_j: Array) -> float:
        """Share of blocks of two keyframes that show other things than a motion has there."""
        return float(self._judged(i, j, [T_i_j]).refuting[0])

    def log_odds_across(self, places: Sequence[Array], a: Inside, b: Inside) -> Array:
        """Of each of several places, poses (N, 4, 4), against each (C, C), by all pixels.

        They are of one coarse place, and join two sets of frames (N,).
        """
        count = len(places)
        pairs = self._overlapping(places[0], a, b, MIN_OVERLAP)[0] if count > 1 else []
        told = [self._judged(i, j, [se3.inverse(T[i]) @ T[j] for T in places]) for i, j in pairs]
        return sum(told[1:], told[0]).log_odds[:count, :count] if told else np.zeros((count, count))

    def _leaps(self, poses: Array, a: Inside, b: Inside) -> list[tuple[int, int]]:
        """Steps from a frame of one set to the next, of the other, that no camera makes, by rows.

        By poses (N, 4, 4) that join the two sets.
        """
        either = a | b
        posed = np.where(either[:, None, None], poses, np.nan)
        part = np.where(either, 0, LOST).astype(np.int32)
        found = jumps(self._odometry.frames, posed, part)
        return [(i, j) for i, j in found if a[i] != a[j]]

    def _across(
        self, poses: Array, a: Inside, b: Inside, min_overlap: float, through_sigmas: float
    ) -> tuple[list[Agreement], list[Agreement]]:
        """How pairs of keyframes of two sets agree by their poses, and neighbours of one segment.

        Those that see so much of each other, `MOST_PAIRS` of either kind.
        """
        pairs, neighbours = self._overlapping(poses, a, b, min_overlap)
        as_seen = self._moving, self._config.registration, through_sigmas
        return agreements(pairs, poses, *as_seen), agreements(neighbours, poses, *as_seen)

    def _overlapping(
        self, poses: Array, a: Inside, b: Inside, min_overlap: float
    ) -> tuple[list[Pair], list[Pair]]:
        """Pairs of keyframes of two sets that see so much of each other, and neighbours that do.

        By poses (N, 4, 4); neighbours are of one segment; `MOST_PAIRS` of either kind.
        """
        odometry = self._odometry
        rows, segment = odometry.keyframe_rows, odometry.segment[odometry.keyframe_rows]
        part = np.where(a | b, 0, LOST).astype(np.int32)
        overlap = view_overlap(odometry, poses, part, self._cameras)
        across = (a[rows][:, None] & b[rows]) | (b[rows][:, None] & a[rows])
        next_to = np.eye(len(rows), k=1, dtype=bool) & (segment[:, None] == segment) & ~across
        pairs, neighbours = (
            evenly(
                rows[np.argwhere(np.triu(wanted & (overlap >= min_overlap)))].tolist(), MOST_PAIRS
            )
            for wanted in (across, next_to)
        )
        return pairs, neighbours

    def _log_odds_before(self, stretch: Contradiction) -> float:
        """Of odometry's motion across a stretch, by the least probable of its frames' edges."""
        return log_odds_of(stretch.weakest(self._odometry.edges)[1])

    def _log_odds_of_steps(self, stretch: Contradiction, motions: Sequence[Array]) -> float:
        """Of the first of two motions across a stretch, by what a camera can do.

        The frames before its weakest, and those from there on, stay as odometry has them.
        """
        odometry, leaps = self._odometry, []
        row, _ = stretch.weakest(odometry.edges)
        inside = odometry.segment == odometry.segment[stretch.j]
        later = np.arange(len(inside)) >= row
        before, after = inside & ~later, inside & later
        for T_i_j in motions:
            poses = odometry.T_segment_camera.copy()
            poses[after] = poses[stretch.i] @ T_i_j @ se3.inverse(poses[stretch.j]) @ poses[after]
            leaps.append(bool(self._leaps(poses, before, after)))
        return float(np.log(RUSH)) * (leaps[0] - leaps[1])

    def revisits(self, poses: Array, depth_delay_s: Array) -> Revisits:
        """Keyframes that see one place at different times, by poses (N, 4, 4) of all frames."""
        odometry, cameras = self._odometry, self._cameras
        return find_revisits(odometry, poses, depth_delay_s, cameras, self._moving, self._config)

    def surface_edges(self, revisits: Revisits, joined: Collection[Pair]) -> list[Edge]:
        """Edges between these by their surfaces, but where pairs are joined already."""
        return surface_edges(revisits, joined, self._moving, self._config.registration)

    def log_odds(self, i: int, j: int, motions: Sequence[Array]) -> Array:
        """Of each motion (C,) from keyframe i to j against each (C + 1, C + 1), none the last."""
        return self._judged(i, j, motions).log_odds

    def _judged(self, i: int, j: int, motions: Sequence[Array]) -> PixelEvidence:
        a, b = (self._moving(row) for row in (i, j))
        return judge(a, b, motions, self._config.registration)

    def _reduced_at(self, row: int) -> ReducedFrame:
        """A keyframe's pixels, and how fast it moved."""
        return reduced(self._views(row)).moving(self._twists[row])

    @cached_property
    def _twists(self) -> Array:
        """Of each frame (N, 6), by the frames of its segment."""
        odometry = self._odometry
        twists = np.zeros((len(odometry.frames), 6))
        for segment in np.unique(odometry.segment):
            inside = odometry.segment == segment
            poses = np.where(inside[:, None, None], odometry.T_segment_camera, np.nan)
            twists[inside] = velocities(poses, odometry.frames)[inside]
        return twists

    def _other_motion(self, stretch: Contradiction) -> Edge | None:
        """An alternative near the motion that closures imply, else one registered from there."""
        ends = stretch.i, stretch.j
        found = (e for e in self._odometry.alternatives if (e.i, e.j) == ends)
        return next((e for e in found if _is_near(e, stretch)), None) or self._registered(stretch)

    def _registered(self, stretch: Contradiction) -> Edge | None:
        """The edge by features, or by pixels where there are too few."""
        i, j, predicted = stretch.i, stretch.j, stretch.T_i_j
        camera = self._cameras[self._odometry.frames.capture[i]]
        rng = np.random.default_rng([self._config.seed, i, j])
        pair = PointRegistration(camera, camera, self._config.registration, self._matcher)
        found = pair.register(self._keyframes[i], self._keyframes[j], rng, predicted)
        if isinstance(found, PoseEstimate):
            return Edge(i, j, found.T_a_b, found.information)
        aligned = align(
            self._views(i), self._views(j), camera, self._config.registration, predicted
        )
        if isinstance(aligned, Rejected) or not aligned.well_constrained:
            return None
        return Edge(i, j, aligned.T_a_b, aligned.information)


def _is_near(edge: Edge, stretch: Contradiction) -> bool:
    return bool(same_pose(se3.inverse(stretch.T_i_j) @ edge.T_i_j))
