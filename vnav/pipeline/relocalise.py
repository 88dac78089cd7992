"""Does a capture show the place of a map? Its keyframes are relocalised in it: claim 4."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import CameraPrior, Intrinsics
from vnav.core.mapping import FrameFeatures, Odometry
from vnav.core.progress import Progress, silent
from vnav.features.appearance import tfidf_similarity
from vnav.io.store.index_file import load_index
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.tree_file import load_tree
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.localise import localise
from vnav.localisation.photo import prepare
from vnav.localisation.query import Query
from vnav.localisation.verdict.decision import Located, NotLocated
from vnav.optimisation.segments import MIN_AGREEING, same_pose

MAX_KEYFRAMES = 48  # that are tried, those that look most like the map's first
BATCH = 8  # of them; the search ends where enough agree


@dataclass(frozen=True)
class RelocalisedKeyframes:
    """Where cameras (S,) of a new capture stood in a map's world, and in their own segments."""

    segment: NDArray[np.int32]
    T_segment_camera: Array
    T_world_camera: Array

    def __len__(self) -> int:
        return len(self.segment)

    def agrees_with(self, others: "RelocalisedKeyframes") -> NDArray[np.bool_]:
        """Which (S, O) of them agree, by the motion between the two in their segment.

        Compared where the first camera stands: from afar, a small turn moves it a long way.
        """
        T_world_segment = others.T_world_camera @ se3.inverse(others.T_segment_camera)
        expected = T_world_segment @ self.T_segment_camera[:, None]
        near = same_pose(se3.inverse(self.T_world_camera)[:, None] @ expected)
        return np.asarray(near & (self.segment[:, None] == others.segment))


@dataclass(frozen=True)
class CaptureRelocalisation:
    """Keyframes of a capture that were located in a map, of those that were tried.

    ``best``: of those not located, the one that came nearest to it.
    """

    located: RelocalisedKeyframes
    tried: int
    best: NotLocated | None

    @property
    def agreeing(self) -> int:
        """How many located keyframes agree with one of them, at the most; each does with itself."""
        return int(self.located.agrees_with(self.located).sum(1).max(initial=0))


def relocalise(
    folder: MapFolder,
    odometry: Odometry,
    camera: Intrinsics,
    config: Config,
    progress: Progress = silent,
) -> CaptureRelocalisation:
    """Relocalise keyframes of the last capture in a map, until enough agree on where it was taken.

    ``folder`` is the map without that capture, ``odometry`` the one with it, whose last capture
    was taken by ``camera``.
    """
    tree = load_tree(folder)
    database = LandmarkDatabase(load_index(folder, tree), tree)

    def locate(keyframe: FrameFeatures) -> Located | NotLocated:
        photo = prepare(keyframe.features, CameraPrior(camera), database.tree)
        query = Query(photo, database, config.locate)
        return localise(query, np.random.default_rng(config.seed))

    keyframes = _most_similar(odometry, database)[:MAX_KEYFRAMES]
    answers: list[Located | NotLocated] = []
    found = _gathered([], [], odometry)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        while len(answers) < len(keyframes) and found.agreeing < MIN_AGREEING:
            answers += pool.map(locate, keyframes[len(answers) :][:BATCH])
            found = _gathered(keyframes, answers, odometry)
            progress("locate", len(answers), len(keyframes))
    progress("locate", len(keyframes), len(keyframes))
    return found


def _most_similar(odometry: Odometry, database: LandmarkDatabase) -> list[FrameFeatures]:
    """Keyframes of the last capture, those first that look most like one of the others."""
    keyframes, captures = odometry.keyframes, odometry.frames.capture
    is_new = captures[odometry.keyframe_rows] == captures[-1]
    similarity = tfidf_similarity(keyframes, database.tree)[is_new][:, ~is_new].max(1)
    new = np.flatnonzero(is_new)
    return [keyframes[k] for k in new[np.argsort(-similarity, kind="stable")]]


def _gathered(
    keyframes: Sequence[FrameFeatures], answers: Sequence[Located | NotLocated], odometry: Odometry
) -> CaptureRelocalisation:
    """What the answers for the first of some keyframes say together."""
    pairs = zip(keyframes, answers, strict=False)
    located = [(k.row, a.best.view.T_world_camera) for k, a in pairs if isinstance(a, Located)]
    others = [answer for answer in answers if isinstance(answer, NotLocated)]
    rows = [row for row, _ in located]
    T_world_camera = np.array([T for _, T in located]).reshape(-1, 4, 4)
    return CaptureRelocalisation(
        RelocalisedKeyframes(
            odometry.segment[rows], odometry.T_segment_camera[rows], T_world_camera
        ),
        len(answers),
        max(others, key=lambda answer: answer.inliers, default=None),
    )
