"""Frames of a robot over time, as /tf and /tf_static tell of them.

What a frame's pose is between two messages is interpolated, linearly and along the shortest
rotation, as tf2 does (github.com/ros2/geometry2); outside of them it is not known.
"""

from array import array
from collections.abc import Iterable, Iterator

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.io.recordings.ros_messages import RosTransform

LONGEST_GAP_S = 1.0  # between two messages; nobody knows where a frame was in a longer one


class TransformTree:
    """Every frame's parent, and its poses in it."""

    def __init__(self) -> None:
        self._edges: dict[str, _Edge] = {}  # by child

    def add(self, transforms: Iterable[RosTransform], *, is_static: bool) -> None:
        """Take in a message; static transforms hold for ever. A frame keeps its first parent."""
        for found in transforms:
            if found.child == found.parent:
                continue
            edge = self._edges.setdefault(found.child, _Edge(found.parent, is_static))
            if edge.parent == found.parent:
                edge.add(found)

    def above(self, frame: str) -> list[str]:
        """The frames that a frame hangs on, the root last."""
        return [edge.parent for edge in self._above(frame)]

    def root(self, frame: str) -> str:
        """The last of the frames that a frame hangs on; itself where it hangs on none."""
        return [frame, *self.above(frame)][-1]

    def moves(self, target: str, frame: str) -> bool:
        """Whether a frame's pose in a frame above it changes over time."""
        return any(not edge.is_static for edge in self._between(target, frame) or ())

    def knows(self, target: str, frame: str) -> bool:
        """Whether two frames are connected."""
        return self.root(target) == self.root(frame)

    def at_first(self, target: str, frame: str) -> Array:
        """T_target_frame (4, 4) of two connected frames, by the first message of each pose."""
        return np.asarray(se3.inverse(self._to_root(target)) @ self._to_root(frame))

    def poses(self, target: str, frame: str, stamps_s: Array) -> Array:
        """T_target_frame (N, 4, 4) in a frame above it; NaN where it is not known."""
        T_target_frame = np.tile(np.eye(4), (len(stamps_s), 1, 1))
        for edge in self._between(target, frame) or ():
            T_target_frame = edge.at(stamps_s) @ T_target_frame
        return T_target_frame

    def _to_root(self, frame: str) -> Array:
        T_above_frame = np.eye(4)
        for edge in self._above(frame):
            T_above_frame = edge.first @ T_above_frame
        return np.asarray(T_above_frame)

    def _above(self, frame: str) -> "Iterator[_Edge]":
        """From a frame up to its root; a circle ends where it closes."""
        seen = {frame}
        while frame in self._edges and self._edges[frame].parent not in seen:
            yield self._edges[frame]
            frame = self._edges[frame].parent
            seen.add(frame)

    def _between(self, target: str, frame: str) -> "list[_Edge] | None":
        """From a frame up to one above it, None where it is not above."""
        edges = list(self._above(frame))
        frames = [frame, *self.above(frame)]
        return edges[: frames.index(target)] if target in frames else None


class _Edge:
    """Poses of one frame in its parent: time in seconds, translation, quaternion."""

    def __init__(self, parent: str, is_static: bool) -> None:
        self.parent, self.is_static = parent, is_static
        self._samples = array("d")

    def add(self, found: RosTransform) -> None:
        T = found.T_parent_child
        self._samples.extend([found.stamp_ns / 10**9, *T[:3, 3], *se3.quat_xyzw(T)])

    @property
    def first(self) -> Array:
        return np.asarray(self._T(np.array(self._samples[:8])[None])[0])

    def at(self, stamps_s: Array) -> Array:
        """Poses (N, 4, 4) at times (N,)."""
        if self.is_static:
            return np.tile(self.first, (len(stamps_s), 1, 1))
        samples = np.array(self._samples).reshape(-1, 8)
        times_s, rows = np.unique(samples[:, 0], return_index=True)
        T = self._T(samples[rows])
        after = np.searchsorted(times_s, stamps_s).clip(0, len(rows) - 1)
        exact = times_s[after] == stamps_s
        before = np.where(exact, after, np.maximum(after - 1, 0))
        gap_s = times_s[after] - times_s[before]
        share = (stamps_s - times_s[before]) / np.where(gap_s > 0, gap_s, 1.0)
        R = T[before][:, :3, :3]
        turn = se3.log_so3(np.swapaxes(R, 1, 2) @ T[after][:, :3, :3])
        t = T[before][:, :3, 3] + share[:, None] * (T[after] - T[before])[:, :3, 3]
        found = se3.make(R @ se3.exp_so3(share[:, None] * turn), t)
        known = exact | ((gap_s > 0) & (gap_s <= LONGEST_GAP_S) & (share >= 0) & (share <= 1))
        found[~known] = np.nan
        return found

    @staticmethod
    def _T(samples: Array) -> Array:
        return se3.make(se3.rotation_from_quat(samples[:, 4:]), samples[:, 1:4])
