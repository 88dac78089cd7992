"""The vocabulary stage: one tree over what the keyframes saw with depth (claim 4, 2.1)."""

import numpy as np

from vnav import vocabulary
from vnav.config import Config
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.io.store.artifacts import load_descriptor_space, load_odometry
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.stage_reports import clock, finished, reused, settings_of
from vnav.io.store.tree_file import write_tree
from vnav.threads import one_blas_thread

STAGE = "vocabulary"


@one_blas_thread
def run(folder: MapFolder, config: Config, *, progress: Progress = silent) -> Report:
    """Train the tree on the keyframe features that carry a 3D point; writes vocabulary/tree.npz.

    Keyframes without any such feature give a tree of one word.
    """
    started = clock()
    settings, inputs = settings_of(config, STAGE), folder.inputs_of("odometry")
    if folder.is_current(STAGE, settings, inputs):
        return reused(folder, STAGE)
    keyframes, space = load_odometry(folder).keyframes, load_descriptor_space(folder)
    with_depth = [k.features.descriptors[k.has_depth] for k in keyframes]
    descriptors = np.concatenate([space.none(), *with_depth])

    progress(STAGE, 0, 1)
    tree = vocabulary.train(descriptors, space, config.vocabulary, config.seed)
    progress(STAGE, 1, 1)

    with folder.writing(STAGE, settings, inputs) as draft:
        write_tree(draft, tree)

    values = {"descriptors": len(descriptors), "words": tree.words, "levels": tree.levels}
    line = f"{tree.words} words on {tree.levels} levels from {len(descriptors)} descriptors"
    return finished(folder, Report(STAGE, values, (line,)), started)
