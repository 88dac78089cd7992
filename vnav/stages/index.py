"""The index stage: landmarks, words and visibility, made ready for finding photos."""

from collections.abc import Sequence

import numpy as np

from vnav.config import Config
from vnav.core.camera import CameraPrior
from vnav.core.mapping import Odometry, OptimisedMap
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.core.voxels import Voxels
from vnav.io.store.artifacts import (
    load_departed,
    load_odometry,
    load_optimised,
    map_camera,
    require_features,
)
from vnav.io.store.index_file import write_index
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.stage_reports import clock, finished, reused, settings_of
from vnav.io.store.tree_file import load_tree
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.indexing import MappedKeyframe, build
from vnav.localisation.localise import localise
from vnav.localisation.photo import prepare
from vnav.localisation.query import Query, missing_levels
from vnav.localisation.verdict.decision import Located
from vnav.threads import one_blas_thread
from vnav.volumes.octree import Octree

STAGE = "index"
ASKED = 5  # keyframes that are sought in the finished index
FORMAT = 4  # of index.npz: what was indexed by another one is indexed anew


@one_blas_thread
def run(folder: MapFolder, config: Config, *, progress: Progress = silent) -> Report:
    """Index the map's landmarks by the words of their descriptors; writes index/index.npz."""
    started = clock()
    settings = settings_of(config, STAGE) | {"format": FORMAT}
    inputs = folder.inputs_of("odometry", "vocabulary", "optimise", "fuse")
    if folder.is_current(STAGE, settings, inputs):
        return reused(folder, STAGE)
    odometry, optimised, tree = load_odometry(folder), load_optimised(folder), load_tree(folder)
    seen = optimised.landmarks
    require_features(odometry, seen.keyframe, seen.feature, folder.root / "optimise" / "map.npz")
    keyframes, retired = _mapped(folder, odometry, optimised), load_departed(folder, len(seen))

    progress(STAGE, 0, 1)
    rng = np.random.default_rng([config.seed, 3])
    voxels, landmarks = _voxels(folder), optimised.landmarks
    index = build(landmarks, retired, keyframes, tree, voxels, config.index, rng)
    found, asked = _found_again(LandmarkDatabase(index, tree), keyframes, config)
    progress(STAGE, 1, 1)

    with folder.writing(STAGE, settings, inputs) as draft:
        write_index(draft, index)

    values = {"landmarks": len(index.points_world), "descriptors": len(index.descriptors)}
    values |= {"retired": int(retired.sum())}
    values |= {"keyframes_asked": asked, "keyframes_found": found}
    missing = missing_levels(config.locate, tree)
    return finished(folder, Report(STAGE, values, _lines(values), missing), started)


def _lines(values: dict[str, int]) -> tuple[str, ...]:
    line = (
        f"{values['landmarks']} landmarks under {values['descriptors']} descriptors;"
        f" {values['keyframes_found']} of {values['keyframes_asked']} keyframes are found again"
    )
    if values["retired"]:
        line += f"; {values['retired']} are retired: what they were on has departed"
    return (line,)


def _found_again(
    database: LandmarkDatabase, keyframes: Sequence[MappedKeyframe], config: Config
) -> tuple[int, int]:
    """How many of some keyframes are located by their own features, and how many of them there are.

    What most photos need is compiled by it, too, before the first of them waits for it.
    """
    mapped = [k for k in keyframes if np.isfinite(k.T_world_camera).all()]
    chosen = mapped[:: max(1, len(mapped) // ASKED)][:ASKED]
    photos = [
        prepare(k.keyframe.features, CameraPrior(k.intrinsics), database.tree) for k in chosen
    ]
    rng = np.random.default_rng(config.seed)
    answers = [localise(Query(photo, database, config.locate), rng) for photo in photos]
    return sum(isinstance(answer, Located) for answer in answers), len(chosen)


def _voxels(folder: MapFolder) -> Voxels:
    octree = Octree.read(folder.file("fuse", "occupancy.bt"))
    leaves = octree.leaves()
    solid = leaves.occupied
    return Voxels.filled(leaves.centres_world[solid], leaves.size_m[solid], octree.resolution_m)


def _mapped(folder: MapFolder, odometry: Odometry, optimised: OptimisedMap) -> list[MappedKeyframe]:
    cameras = [map_camera(folder, k) for k in range(len(folder.captures))]
    places = zip(odometry.keyframes, optimised.keyframe_covariance, strict=True)
    return [
        MappedKeyframe(
            keyframe,
            optimised.T_world_camera[keyframe.row],
            covariance,
            cameras[odometry.frames.capture[keyframe.row]],
        )
        for keyframe, covariance in places
    ]
