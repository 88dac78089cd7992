"""Maps of synthetic scenes with the true poses: what finding photos is calibrated and measured on.

Odometry, vocabulary and loops are vnav's own; the poses are the truth, and the landmarks are lifted
from them. Closures that the truth contradicts are left out.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vnav.bundle import Bundle, SensorModel
from vnav.config import Config
from vnav.core import se3
from vnav.core.mapping import Landmarks, Odometry, OptimisedMap, World
from vnav.io import artifacts
from vnav.io.capture import open_capture
from vnav.io.map_folder import MapFolder
from vnav.io.trajectories import read_tum, write_tum
from vnav.stages import fuse, index, landmarks, loops, odometry, vocabulary
from vnav.synthetic.capture import KINECT, PHONE, CaptureSpec, write_capture

RIGHT_M, RIGHT_RAD = 0.15, 0.1  # of a closure


def synthetic_map(root: Path, scene: str, seed: int, frames: int, photos: int) -> MapFolder:
    """The finished map of a scene in root/map; its capture is in root/capture. Made once."""
    capture = root / "capture"
    if not (capture / "camera.toml").is_file():
        write_capture(capture, CaptureSpec(scene, frames, photos, KINECT, PHONE, seed=seed))
    folder = MapFolder.create(root / "map")
    if (folder.stage("index") / "index.npz").is_file():
        return folder
    config = Config()
    odometry.run(folder, [open_capture(capture, config.capture)], config)
    for stage in (vocabulary, loops):
        stage.run(folder, config)
    _optimise(folder, capture, config)
    for stage in (fuse, index):
        stage.run(folder, config)
    return folder


def _optimise(folder: MapFolder, capture: Path, config: Config) -> None:
    """The optimise stage, by the truth."""
    truth = read_tum(capture / "groundtruth.txt")
    found = artifacts.load_odometry(folder)
    keyframes = len(found.keyframes)
    result = OptimisedMap(
        truth.T_world_camera,
        np.zeros((keyframes, 6, 6)),
        _landmarks(folder, found, truth.T_world_camera, config),
        World("floor", 1, 0.0),
    )
    with folder.writing("optimise", {}, folder.inputs_of("odometry", "loops")) as draft:
        artifacts.save_optimised(draft, result)
        artifacts.save_verdicts(draft, artifacts.load_loops(folder, "loops"))
        write_tum(draft / "trajectory_0.tum", truth)


def _landmarks(
    folder: MapFolder, found: Odometry, T_world_camera: NDArray[np.float64], config: Config
) -> Landmarks:
    rows = [keyframe.row for keyframe in found.keyframes]
    number = {row: k for k, row in enumerate(rows)}
    edges, matches = artifacts.load_loop_edges(folder)
    right = set()
    for e in edges:
        off = se3.inverse(e.T_i_j) @ se3.inverse(T_world_camera[e.i]) @ T_world_camera[e.j]
        if np.linalg.norm(off[:3, 3]) < RIGHT_M and se3.rotation_angle(off) < RIGHT_RAD:
            right.add((number[e.i], number[e.j]))
    keep = np.array([(int(i), int(j)) in right for i, j in matches[:, [0, 2]]], bool)
    tracks = landmarks.Tracks(found.keyframes, matches[keep])
    model = SensorModel([artifacts.map_camera(folder, 0)] * len(rows), config.registration)
    poses = T_world_camera[rows]
    seen = np.flatnonzero(
        np.isfinite(tracks.lifted(poses, np.arange(len(tracks.seen)))[tracks.seen.landmark, 0])
    )
    for slack in (4.0, 1.0, 1.0):
        bundle = Bundle(poses, tracks.lifted(poses, seen))
        seen = landmarks._inliers(bundle, tracks, seen, model, slack)
    return landmarks._landmarks(Bundle(poses, tracks.lifted(poses, seen)), tracks, seen, model)
