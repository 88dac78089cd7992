"""The constant-velocity motion model: where the next frame will be if the motion goes on.

A hand or a robot changes its velocity little from frame to frame. What is far from the predicted
pose is less likely, but not by much: somebody may stumble, and the last step may be mistaken. Then
the one before tells where the camera is.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.jumps import FASTEST, RUSH, TIMES_FASTER, speeds

ACCELERATIONS = 3.0, 2.0  # rad/s2, m/s2: usual ones of a camera that is carried
STEP_SIGMAS = 0.002, 0.003  # rad, m: of a step that was measured
MAX_STEPS = 3.5  # time steps that the velocity is trusted for; after a longer gap it is not
REMEMBERED = 3  # steps: that so many are mistaken one after the other is rare


@dataclass(frozen=True)
class PastStep:
    """A motion (4, 4) that took so long, to a pose of that time; ``probability`` that it is right.

    ``took_s`` is 0 where a track begins.
    """

    T_start_camera: Array
    motion: Array
    took_s: float
    stamp_s: float
    probability: float

    def onward(self, stamp_s: float) -> Array:
        """The motion from its pose until a time, if it goes on: longer after a gap."""
        gap_s = stamp_s - self.stamp_s
        steps = gap_s / self.took_s if self.took_s > 0 else 1.0
        return _scaled(self.motion, float(np.clip(steps, 0.0, MAX_STEPS)))

    def goes_on(self, T_likely_next: Array, stamp_s: float) -> Array:
        """How likely the camera (..., 4, 4) is so far from where the step leads, 1 at most.

        Cauchy's tails.
        """
        gap_s = stamp_s - self.stamp_s
        usual = np.array(ACCELERATIONS) * gap_s * (gap_s + self.took_s) / 2 + STEP_SIGMAS
        off = se3.angle_and_distance(T_likely_next)
        return np.asarray(1 / np.prod(1 + (off / usual) ** 2, -1))


class ConstantVelocity:
    """Poses since the track began, and the motion that is predicted to the next frame."""

    def __init__(self) -> None:
        self._T_start_camera: dict[int, Array] = {}
        self._steps: deque[PastStep] = deque(maxlen=REMEMBERED)  # of this track, the newest last
        self._next_s = 0.0
        self._T_last_next = np.eye(4)
        self._T_suggested: Array | None = None

    def predict(self, stamp_s: float) -> None:
        """Predict the motion to a frame of this time: the last step, longer after a gap."""
        self._next_s = stamp_s
        self._T_last_next = self._steps[-1].onward(stamp_s) if self._steps else np.eye(4)
        self._T_suggested = None

    def replace_prediction(self, T_last_next: Array) -> None:
        """Take a measured motion to the next frame for the predicted one, until `predict`."""
        self._T_last_next = T_last_next

    def suggest(self, T_last_next: Array) -> None:
        """Expect the next frame where a motion takes it, too, and first of all; until `predict`.

        That is where it is sought. How likely a pose is by itself stays as it was.
        """
        self._T_suggested = T_last_next

    def update(self, row: int, T_target_camera: dict[int, Array], probability: float = 1.0) -> None:
        """Add the next frame by its motions from earlier ones, by their rows, the best first.

        ``probability``: that they are the camera's. Without one from a frame of this track, a new
        track begins.
        """
        known = [(i, T) for i, T in T_target_camera.items() if i in self._T_start_camera]
        if known:
            pose = self._T_start_camera[known[0][0]] @ known[0][1]
            last = self._steps[-1]
            step, took_s = se3.inverse(last.T_start_camera) @ pose, self._next_s - last.stamp_s
        else:
            self._T_start_camera.clear()
            self._steps.clear()
            pose, step, took_s = np.eye(4), np.eye(4), 0.0
        self._steps.append(PastStep(pose, step, took_s, self._next_s, probability))
        self._T_start_camera[row] = pose

    @property
    def poses(self) -> Mapping[int, Array]:
        """``T_start_camera`` of every frame of this track, by its row."""
        return self._T_start_camera

    @property
    def expected(self) -> list[Array]:
        """Where the next frame is in the track, the likeliest first.

        By a motion that was suggested, if the motion goes on, and if the camera rests.
        """
        T_start_last = self._steps[-1].T_start_camera
        suggested = [] if self._T_suggested is None else [self._T_suggested]
        return [T_start_last @ T for T in (*suggested, self._T_last_next)] + [T_start_last]

    def log_prior(self, T_start_next: Array) -> Array:
        """How likely the next frame is at poses (..., 4, 4): log-densities, 0 if it goes on.

        It is 0 anywhere before there is a velocity. Where the last step was mistaken, the motion
        goes on as the step before; another pose is as likely as all of them were: what repeats goes
        on as another motion would. What is faster than a camera is carried is hardly likely.
        """
        likely = np.ones(T_start_next.shape[:-2])
        for step in self._steps:
            if step.took_s <= 0:
                continue
            is_last = step is self._steps[-1]
            T_step_next = self._T_last_next if is_last else step.onward(self._next_s)
            T_likely_next = se3.inverse(step.T_start_camera @ T_step_next) @ T_start_next
            goes_on, p = step.goes_on(T_likely_next, self._next_s), max(step.probability, 0.5)
            likely = goes_on + (1 - goes_on) * likely * (1 - p) / p
        return np.asarray(np.log(likely * np.where(self._is_rush(T_start_next), RUSH, 1.0)))

    def _is_rush(self, T_start_next: Array) -> NDArray[np.bool_]:
        """At which poses the camera went faster than one is carried, and than it did before."""
        last = self._steps[-1]
        gap_s = self._next_s - last.stamp_s
        if last.took_s <= 0 or gap_s <= 0:
            return np.zeros(T_start_next.shape[:-2], bool)
        before = [speeds(step.motion, step.took_s) for step in self._steps if step.took_s > 0]
        limits = np.maximum(FASTEST, TIMES_FASTER * np.max(before, 0))
        asked = speeds(se3.inverse(last.T_start_camera) @ T_start_next, max(gap_s, last.took_s))
        return np.asarray((asked > limits).any(-1))

    @property
    def twist(self) -> Array:
        """Of the last step (6,), rotation first, in rad/s and m/s; 0 before there is one."""
        if not self._steps or self._steps[-1].took_s <= 0:
            return np.zeros(6)
        return np.asarray(se3.deviation(self._steps[-1].motion) / self._steps[-1].took_s)

    def predicted(self, target: int) -> Array | None:
        """``T_target_camera`` of the next frame; None where the target is of another track."""
        if target not in self._T_start_camera:
            return None
        return np.asarray(se3.inverse(self._T_start_camera[target]) @ self.expected[0])

    def between(self, i: int, j: int) -> Array | None:
        """``T_i_j`` of two frames; None where not both are of this track."""
        if not (i in self._T_start_camera and j in self._T_start_camera):
            return None
        return np.asarray(se3.inverse(self._T_start_camera[i]) @ self._T_start_camera[j])


def _scaled(step: Array, steps: float) -> Array:
    """A motion a number of times, turning and moving evenly."""
    return se3.make(se3.exp_so3(steps * se3.log_so3(step[:3, :3])), steps * step[:3, 3])
