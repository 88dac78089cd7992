"""What a map holds, as the rerun viewer shows it."""

from pathlib import Path

import numpy as np

from vnav.core.arrays import Array
from vnav.core.mapping import FrameTable
from vnav.core.point_cloud import PointCloud
from vnav.core.posed_images import PosedImages
from vnav.io.files import read_bytes
from vnav.io.formats.rrd import RerunRecording
from vnav.io.store.artifacts import (
    load_cloud,
    load_frame_table,
    load_loops,
    load_mesh,
    load_optimised,
    load_trajectory,
)
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.posed_keyframes import load_posed_keyframes
from vnav.io.store.records import located_camera, planned_points

BLUE, PURPLE, GREEN = (30, 136, 229), (171, 71, 188), (67, 160, 71)
KEYFRAME_M, CAMERA_M, PHOTO_M = 0.12, 0.3, 0.5  # how long cameras are drawn


def write_viewed_map(folder: MapFolder, path: Path) -> None:
    """Write cloud, surface, landmarks, cameras over time, keyframes, loops, photos and path.

    Photos are those located last, the path the last one. `require_rerun` first.
    """
    views, frames = load_posed_keyframes(folder), load_frame_table(folder)
    recording = RerunRecording()
    recording.add_cloud("cloud", load_cloud(folder))
    recording.add_mesh("mesh", load_mesh(folder))
    recording.add_cloud("landmarks", PointCloud(views.landmarks.points_world, views.colors))
    _add_trajectories(recording, frames, load_optimised(folder).T_world_camera)
    _add_cameras(recording, folder, views, frames)
    for image in views.images:
        name, camera = f"keyframes/{image.name}", views.cameras[image.camera]
        recording.add_camera(name, camera, KEYFRAME_M, image.T_world_camera)
    _add_loops(recording, folder, views)
    _add_asked(recording, folder)
    recording.write(path)


def _add_trajectories(recording: RerunRecording, frames: FrameTable, poses: Array) -> None:
    """Lines a capture, broken where frames have no pose."""
    for capture in np.unique(frames.capture).tolist():
        centres = poses[frames.capture == capture, :3, 3]
        known = np.isfinite(centres).all(1)
        pieces = np.split(centres, np.flatnonzero(np.diff(known)) + 1)
        lines = [piece for piece in pieces if np.isfinite(piece).all() and len(piece) > 1]
        recording.add_lines(f"trajectory_{capture}", lines, BLUE)


def _add_cameras(
    recording: RerunRecording, folder: MapFolder, views: PosedImages, frames: FrameTable
) -> None:
    """A camera a capture, which moves as time goes on, with the keyframes' images."""
    for capture, camera in enumerate(views.cameras):
        if f"trajectory_{capture}.tum" not in folder.files("optimise"):
            continue
        name = f"camera_{capture}"
        rows = [image.row for image in views.images if image.camera == capture]
        files = (folder.file("odometry", f"keyframes/{row:06d}.jpg") for row in rows)
        recording.add_camera(name, camera, CAMERA_M, load_trajectory(folder, capture))
        recording.add_jpegs(name, frames.stamp_s[rows], [read_bytes(file) for file in files])


def _add_loops(recording: RerunRecording, folder: MapFolder, views: PosedImages) -> None:
    """Lines between the keyframes that kept loops join."""
    centres = {image.number: image.T_world_camera[:3, 3] for image in views.images}
    kept = [(v.i, v.j) for v in load_loops(folder) if v.accepted and v.is_loop]
    lines = [np.array([centres[i], centres[j]]) for i, j in kept if {i, j} <= centres.keys()]
    recording.add_lines("loops", lines, PURPLE)


def _add_asked(recording: RerunRecording, folder: MapFolder) -> None:
    """Where photos were taken, and a path: as far as the map remembers them."""
    notes = {"photo": folder.current()}
    notes |= {f"photos/{number}": note for number, note in enumerate(folder.photos())}
    for name, note in notes.items():
        located = located_camera(note)
        if located:
            T_world_camera, camera = located
            recording.add_camera(name, camera, PHOTO_M, T_world_camera)
    points = planned_points(folder.planned())
    if points is not None:
        recording.add_lines("path", [points], GREEN)
