"""What the stages of a map hand to each other."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array, frozen
from vnav.core.frame import Edge, Features
from vnav.core.trajectory import Trajectory

LOST = -1
EVEN_S = 1e-3  # by which stamps of depth may vary against colour's, and count as even
FOLLOWED_S, TIMES_USUAL = 0.4, 3.0  # seconds, and usual steps, for which a hand's motion goes on
MOST_SPANS = 10  # lost for one reason, that are told one by one
EVEN_LIGHT = frozen(np.array([[1, 0, 0]], np.float32), np.float32, (1, 3))  # of one capture
CONTRADICTS = "disagrees with the pose graph"  # reason of a loop that was found and is not kept
FLOOR_OFF_M, FLOOR_TILT_DEG = 0.05, 2.0  # of a given world, where the grid still fits


@dataclass(frozen=True)
class FrameTable:
    """Every frame of the map's captures, in order; a row of it is how a frame is named inside.

    ``capture`` (N,), ``index`` (N,) int32: the frame's key; ``stamp_s`` (N,) float64;
    ``depth_after_s`` (N,) float64: how much later depth's stamp is, NaN where the frame
    cannot be read; by default not at all.
    """

    capture: NDArray[np.int32]
    index: NDArray[np.int32]
    stamp_s: NDArray[np.float64]
    depth_after_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        n = len(self.capture)
        after_s = self.depth_after_s if len(self.depth_after_s) else np.zeros(n)
        object.__setattr__(self, "depth_after_s", frozen(after_s, np.float64, (n,)))
        object.__setattr__(self, "capture", frozen(self.capture, np.int32, (n,)))
        object.__setattr__(self, "index", frozen(self.index, np.int32, (n,)))
        object.__setattr__(self, "stamp_s", frozen(self.stamp_s, np.float64, (n,)))

    def __len__(self) -> int:
        return len(self.capture)

    @property
    def uneven_s(self) -> NDArray[np.float64]:
        """How much later than its capture's median each frame's depth is stamped (N,).

        0 where it is not known, and in a capture where that stays within `EVEN_S`.
        """
        uneven_s = np.zeros(len(self))
        for capture in np.unique(self.capture):
            rows = (self.capture == capture) & np.isfinite(self.depth_after_s)
            varies_s = self.depth_after_s[rows]
            varies_s = varies_s - np.median(varies_s) if len(varies_s) else varies_s
            if np.abs(varies_s).max(initial=0) >= EVEN_S:
                uneven_s[rows] = varies_s
        return uneven_s

    def of_captures(self) -> list[NDArray[np.intp]]:
        """The rows of each capture's frames."""
        return [np.flatnonzero(self.capture == number) for number in np.unique(self.capture)]

    def interrupted(self, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """After which of a capture's frames (N,), in order, the camera was not followed (N - 1,).

        How a hand goes on is told for some tenths of a second by how it moved.
        """
        gap_s = np.diff(self.stamp_s[rows])
        usual_s = np.median(gap_s) if len(gap_s) else 0.0
        return np.asarray(gap_s > max(FOLLOWED_S, TIMES_USUAL * usual_s))

    def lost_spans(self, reasons: Sequence[str]) -> list["Span"]:
        """Runs of neighbouring frames of one capture lost for one reason, empty where not lost."""
        rows = zip(self.capture.tolist(), reasons, self.index.tolist(), strict=True)
        found = []
        for (capture, reason), group in groupby(rows, key=lambda row: row[:2]):
            index = [index for *_, index in group]
            if reason:
                found.append(Span(capture, index[0], index[-1], reason))
        return found

    def span_text(self, capture: int, first: int, last: int) -> str:
        """Frames of a capture by their index, for a person."""
        frames = f"frame {first}" if first == last else f"frames {first} to {last}"
        return f"{frames} of capture {capture}" if self.capture.any() else frames

    def rows_text(self, rows: NDArray[np.intp]) -> str:
        """Which frames some rows are, from first to last of each capture, for a person."""
        parts = []
        for capture in np.unique(self.capture[rows]).tolist():
            index = self.index[rows[self.capture[rows] == capture]]
            parts.append(self.span_text(capture, int(index[0]), int(index[-1])))
        return " and ".join(parts)


@dataclass(frozen=True)
class Span:
    """Neighbouring frames of one capture, by index, and what is to be said of them."""

    capture: int
    first: int
    last: int
    reason: str


def in_short(spans: Sequence[Span]) -> list[Span]:
    """The spans, one for all those of a capture and a reason that has more than `MOST_SPANS`."""
    alike: dict[tuple[int, str], list[Span]] = {}
    for span in spans:
        alike.setdefault((span.capture, span.reason), []).append(span)
    found = []
    for (capture, reason), group in alike.items():
        if len(group) > MOST_SPANS:
            count = sum(span.last - span.first + 1 for span in group)
            whole = f"{count} of them, {reason}"
            group = [Span(capture, group[0].first, group[-1].last, whole)]
        found += group
    return sorted(found, key=lambda span: (span.capture, span.first))


@dataclass(frozen=True)
class FrameFeatures:
    """A frame kept with its features.

    ``row`` in the frame table; ``points_camera`` (N, 3) float32: each feature's 3D point in the
    colour camera from its own depth, NaN where depth is missing or lies on an edge.
    ``is_coarse``: found in the image at half its size. ``triangulated`` (N, 2): of features without
    depth, inverse depth (1/m) and its standard deviation by what other views tell; None by none.
    """

    row: int
    features: Features
    points_camera: NDArray[np.float32]
    is_coarse: bool = False
    triangulated: Array | None = None

    def __post_init__(self) -> None:
        shape = (len(self.features), 3)
        object.__setattr__(self, "points_camera", frozen(self.points_camera, np.float32, shape))

    def __getitem__(self, selection: NDArray[np.intp] | NDArray[np.bool_]) -> "FrameFeatures":
        """The frame with the selected features, in the order of the selection."""
        return replace(
            self,
            features=self.features[selection],
            points_camera=self.points_camera[selection],
            triangulated=None if self.triangulated is None else self.triangulated[selection],
        )

    @property
    def has_depth(self) -> NDArray[np.bool_]:
        """Which features (N,) carry a 3D point."""
        return np.isfinite(self.points_camera[:, 2])


@dataclass(frozen=True)
class Odometry:
    """Result of the odometry stage.

    ``T_segment_camera`` (N, 4, 4): pose of every frame in the first frame of its segment, NaN
    where lost; ``segment`` (N,): number of its segment, LOST where lost; ``reasons``: why, empty
    where tracked; ``edges`` between rows; ``keyframes`` in order of row; ``given``: the poses come
    from outside and stay as they are, in the world that they were given in; ``T_world_before``
    (N, 4, 4): of a map that was extended, the poses it had before, whose world it keeps, NaN where
    there was none; ``degenerate_edges``: by all pixels, of frames that neither features
    nor these hold in every direction; they make no segments, and join no parts; ``alternatives``:
    other motions between the ends of ``edges``, which the images bear out about as well;
    ``moving_share`` (N,): how much of each frame moves, NaN where too much did for a mask; (0,)
    where nobody looked; ``has_scale``: lengths are in metres, else in a unit of each segment's own;
    ``landmarks`` (M, 3) float32: points that a filter followed, in the first frame of the longest
    segment; ``light`` (C, 2) float32: of each capture, how bright the corners of its images were,
    1 in the centre, before that was taken off, and the standard deviation of its logarithm; 1 and 0
    where nothing was.
    """

    frames: FrameTable
    T_segment_camera: NDArray[np.float64]
    segment: NDArray[np.int32]
    reasons: tuple[str, ...]
    edges: tuple[Edge, ...]
    keyframes: tuple[FrameFeatures, ...]
    given: bool = False
    T_world_before: NDArray[np.float64] | None = None
    degenerate_edges: tuple[Edge, ...] = ()
    alternatives: tuple[Edge, ...] = ()
    moving_share: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    has_scale: bool = True
    landmarks: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    light: NDArray[np.float32] = field(default_factory=lambda: EVEN_LIGHT)

    @property
    def longest_segment(self) -> NDArray[np.intp]:
        """Rows (M,) of the frames of the segment that has most of them, the first of such."""
        tracked = self.segment[self.segment != LOST]
        return np.flatnonzero(self.segment == np.bincount(tracked).argmax())

    @property
    def trajectory(self) -> Trajectory:
        """Poses of the frames of the longest segment."""
        rows = self.longest_segment
        return Trajectory(self.frames.stamp_s[rows], self.T_segment_camera[rows])

    @property
    def keyframe_rows(self) -> NDArray[np.intp]:
        """Row (K,) of each keyframe in the frame table, ascending."""
        return np.array([keyframe.row for keyframe in self.keyframes], np.intp)

    @property
    def motions(self) -> tuple[Edge, ...]:
        """All edges, degenerate ones too."""
        return (*self.edges, *self.degenerate_edges)

    @property
    def taken_off(self) -> list[dict[str, Any]]:
        """As plain values, which captures' light was made even.

        How bright the ``corners`` were, and how many ``bands`` lay over the height of the image.
        """
        names = "corners", "sigma", "bands"
        return [
            {"capture": k, **{n: round(float(x), 4) for n, x in zip(names, light, strict=True)}}
            for k, light in enumerate(self.light)
            if light[0] < 1 or light[2] > 0
        ]


def light_texts(corners: float, bands: float) -> list[str]:
    """What is told of light that was made even."""
    told = [f"brightness falls to {corners:.0%} at the corners: taken off"] if corners < 1 else []
    if bands > 0:
        told.append(f"lamps flicker, {bands:.1f} bands of light to an image: taken off")
    return told


def overlay_text(share: float) -> str:
    """What is told of an overlay."""
    return f"{share:.1%} of the image shows the same in all views, as burnt-in text does"


@dataclass(frozen=True)
class LoopVerdict:
    """One candidate pair of keyframes (numbers into the keyframes), accepted or not, and why.

    ``source``: "appearance", "ends" or "proximity"; ``score`` its TF-IDF similarity or, for
    proximity, the share of the view that both see. ``is_loop``: of another time, segment or
    capture; the others are neighbours, which close nothing.
    """

    i: int
    j: int
    source: str
    score: float
    accepted: bool
    reason: str
    matches: int
    inliers: int
    is_loop: bool = True


def counted(verdicts: Sequence[LoopVerdict]) -> dict[str, Any]:
    """Loops ``tried, accepted, rejected``, why (``reasons``), and neighbours tried and accepted."""
    loops = [v for v in verdicts if v.is_loop]
    neighbours = [v for v in verdicts if not v.is_loop]
    reasons = Counter(v.reason for v in loops if not v.accepted)
    return {
        "tried": len(loops),
        "accepted": len(loops) - reasons.total(),
        "rejected": reasons.total(),
        "reasons": dict(sorted(reasons.items())),
        "neighbours_tried": len(neighbours),
        "neighbours_accepted": sum(v.accepted for v in neighbours),
    }


@dataclass(frozen=True)
class Landmarks:
    """3D points of the map and where keyframes saw them.

    Parameters
    ----------
    points_world
        (L, 3) float32, metres.
    sigma_m
        (L,) float32, one standard deviation of the position, root mean square over the axes.
    landmark, keyframe, feature
        (M,) int32, one row an observation: keyframe number ``keyframe`` saw ``landmark`` as its
        ``feature``. Sorted by landmark, then keyframe.
    """

    points_world: NDArray[np.float32]
    sigma_m: NDArray[np.float32]
    landmark: NDArray[np.int32]
    keyframe: NDArray[np.int32]
    feature: NDArray[np.int32]

    def __post_init__(self) -> None:
        n, m = len(self.points_world), len(self.landmark)
        object.__setattr__(self, "points_world", frozen(self.points_world, np.float32, (n, 3)))
        object.__setattr__(self, "sigma_m", frozen(self.sigma_m, np.float32, (n,)))
        for name in ("landmark", "keyframe", "feature"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.int32, (m,)))

    def __len__(self) -> int:
        return len(self.points_world)


@dataclass(frozen=True)
class World:
    """How the world frame was found: z up, floor at z = 0.

    ``source`` is "floor", "structure" or "cameras"; "given" where the poses came with a world, or
    "kept" where an extended map keeps the one it had; ``floor_points`` the points found on the
    floor; ``floor_rms_m`` their spread about its plane, None without a floor; ``floor_z_m``,
    ``floor_tilt_deg``: where a given or kept world has the floor that was found, below the first
    camera, and the angle of its normal to z; ``up_in_images``: the side of the images that is up:
    "top", "bottom", "left", "right", "behind" or "ahead"; ``floor_less_stands``: far less stands on
    the floor than on the ceiling, if that were the floor.
    """

    source: str
    floor_points: int
    floor_rms_m: float | None
    floor_z_m: float | None = None
    floor_tilt_deg: float | None = None
    up_in_images: str = "top"
    floor_less_stands: bool = False

    @property
    def doubt(self) -> str:
        """Why heights and the grid may be wrong; empty where they are not."""
        if self.source == "floor":
            return ""
        if self.source not in ("given", "kept"):
            return f"no floor was seen: up was found from the {self.source}"
        if self.floor_z_m is None or self.floor_tilt_deg is None:
            return f"no floor was seen: z up and z = 0 are as {self.source}"
        if abs(self.floor_z_m) <= FLOOR_OFF_M and self.floor_tilt_deg <= FLOOR_TILT_DEG:
            return ""
        return (
            f"in the {self.source} world the floor lies at z = {self.floor_z_m:.2f} m, tilted by"
            f" {self.floor_tilt_deg:.0f} deg: heights and the grid expect it at z = 0, z up"
        )


def how_held(up_in_images: str) -> str:
    """How cameras were held whose images have up at that side; empty if upright."""
    if up_in_images in ("behind", "ahead"):
        return "the camera looks " + ("down" if up_in_images == "behind" else "up")
    return f"up is at the {up_in_images} of the images" if up_in_images != "top" else ""


@dataclass(frozen=True)
class OptimisedMap:
    """Result of the optimise stage.

    ``T_world_camera`` (N, 4, 4): every frame of the frame table, NaN where it is not part of the
    main map; ``keyframe_covariance`` (K, 6, 6): marginal of each keyframe's tangent, rotation
    first, relative to the keyframe that sees most, or to the world where poses are given;
    ``landmarks`` with keyframe numbers as in `Odometry`; ``depth_delay_s`` (N,): how long
    after colour, whose pose a frame's is, its depth was measured.
    """

    T_world_camera: NDArray[np.float64]
    keyframe_covariance: NDArray[np.float64]
    landmarks: Landmarks
    world: World
    depth_delay_s: NDArray[np.float64]
