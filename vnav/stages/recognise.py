"""Does a capture show the place of a map? Its keyframes are looked for as photos are: claim 4."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.mapping import Keyframe, Odometry
from vnav.core.progress import Progress, silent
from vnav.features.appearance import tfidf_similarity
from vnav.io.index_file import load_index
from vnav.io.map_folder import MapFolder
from vnav.io.tree_file import load_tree
from vnav.localisation.atlas import Atlas
from vnav.localisation.localise import Located, NotLocated, localise
from vnav.localisation.photo import prepare
from vnav.localisation.query import Query
from vnav.posegraph import alike

Array = NDArray[np.float64]
MOST = 48  # keyframes that are asked, those that look most like the map's first
AT_ONCE = 8  # of them; asking ends where enough agree
AGREEING = 3  # of one segment: each is right with a chance of 95 % and more, wrong ones differ


@dataclass(frozen=True)
class Recognised:
    """Keyframes of a capture that were located in a map, of those that were asked.

    ``segment`` (S,) of the odometry, and where each located keyframe puts it, ``T_world_segment``
    (S, 4, 4); ``best``: of those not located, the one that came nearest to it.
    """

    segment: NDArray[np.int32]
    T_world_segment: Array
    asked: int
    best: NotLocated | None

    def __len__(self) -> int:
        return len(self.segment)

    def bears_out(self, segment: NDArray[np.int32], T_world_segment: Array) -> NDArray[np.bool_]:
        """Which of other places (N, 4, 4) of segments (N,) a located keyframe agrees with."""
        return np.asarray(self._agrees(segment, T_world_segment).any(1))

    @property
    def agreeing(self) -> int:
        """How many located keyframes agree on the place of a segment, at the most."""
        return int(self._agrees(self.segment, self.T_world_segment).sum(1).max(initial=0))

    def _agrees(self, segment: NDArray[np.int32], T_world_segment: Array) -> NDArray[np.bool_]:
        same = segment[:, None] == self.segment
        return np.asarray(same & alike(T_world_segment, self.T_world_segment))


def recognise(
    folder: MapFolder,
    odometry: Odometry,
    camera: Intrinsics,
    config: Config,
    progress: Progress = silent,
) -> Recognised:
    """Look for keyframes of the last capture in a map, until enough agree on where it was taken.

    ``folder`` is the map without that capture, ``odometry`` the one with it, whose last capture
    was taken by ``camera``.
    """
    atlas = Atlas(load_index(folder), load_tree(folder))

    def ask(keyframe: Keyframe) -> Located | NotLocated:
        photo = prepare(keyframe.features, camera, 0.0, atlas.tree)
        query = Query(photo, atlas, config.locate)
        return localise(query, np.random.default_rng(config.seed))

    keyframes = _most_alike(odometry, atlas)[:MOST]
    found = Recognised(np.zeros(0, np.int32), np.zeros((0, 4, 4)), 0, None)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        while found.asked < len(keyframes) and found.agreeing < AGREEING:
            batch = keyframes[found.asked : found.asked + AT_ONCE]
            for keyframe, result in zip(batch, pool.map(ask, batch), strict=True):
                found = _with(found, keyframe, result, odometry)
            progress("locate", found.asked, len(keyframes))
    progress("locate", len(keyframes), len(keyframes))
    return found


def _most_alike(odometry: Odometry, atlas: Atlas) -> list[Keyframe]:
    """Keyframes of the last capture, those first that look most like one of the others."""
    keyframes, captures = odometry.keyframes, odometry.frames.capture
    is_new = captures[[k.row for k in keyframes]] == captures[-1]
    likeness = tfidf_similarity(keyframes, atlas.tree)[is_new][:, ~is_new].max(1)
    new = np.flatnonzero(is_new)
    return [keyframes[k] for k in new[np.argsort(-likeness, kind="stable")]]


def _with(
    found: Recognised, keyframe: Keyframe, result: Located | NotLocated, odometry: Odometry
) -> Recognised:
    """What was found so far, and one keyframe's answer."""
    if isinstance(result, NotLocated):
        best = max(filter(None, (found.best, result)), key=lambda r: r.inliers)
        return Recognised(found.segment, found.T_world_segment, found.asked + 1, best)
    T_world_camera = result.best.view.T_world_camera
    T_world_segment = T_world_camera @ se3.inverse(odometry.T_segment_camera[keyframe.row])
    return Recognised(
        np.append(found.segment, odometry.segment[keyframe.row]),
        np.concatenate([found.T_world_segment, T_world_segment[None]]),
        found.asked + 1,
        found.best,
    )
