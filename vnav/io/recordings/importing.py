"""A recording of a robot becomes a capture folder."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from vnav.core.camera import Camera
from vnav.core.frame import Rejected
from vnav.core.progress import Progress, silent
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError
from vnav.io.recordings.capture_draft import KINDS, CaptureDraft, new_capture
from vnav.io.recordings.ros_bag import TRANSFORMS, RosBag, open_bag
from vnav.io.recordings.ros_messages import (
    RosCameraInfo,
    RosCompressedImage,
    RosImage,
    RosMessage,
)
from vnav.io.recordings.ros_plan import STATIC, ImportPlan, plan_import
from vnav.io.recordings.ros_topics import TopicNames
from vnav.io.recordings.transform_tree import TransformTree
from vnav.io.sources.open_capture import recognised
from vnav.io.sources.record3d import is_recording

MOST_NAMED = 100  # of the messages that are skipped
NOT_NAMED = TopicNames()


@dataclass(frozen=True)
class ImportedCapture:
    """What a recording was found to hold, and where it is now.

    ``depth``: "" where there is none. ``skipped``: messages that are not in the capture, and why.
    """

    folder: Path
    color: str
    depth: str
    camera_info: str
    camera: Camera
    color_images: int
    depth_images: int
    poses: int
    fixed_frame: str  # of the poses
    skipped: tuple[str, ...]
    skipped_count: int  # `MOST_NAMED` are named
    other_cameras: int  # messages by which the camera is another than by the first, which is used


@dataclass
class _Heard:
    """What is gathered beside the images."""

    tree: TransformTree = field(default_factory=TransformTree)
    skipped: list[str] = field(default_factory=list)
    skipped_count: int = 0
    other_cameras: int = 0

    def skip(self, number: int, topic: str, why: Rejected) -> None:
        self.skipped_count += 1
        if len(self.skipped) < MOST_NAMED:
            self.skipped.append(f"image {number} of {topic} is skipped: {why.reason}")


def import_recording(
    source: Path,
    folder: Path,
    named: TopicNames = NOT_NAMED,
    fixed_frame: str | None = None,
    progress: Progress = silent,
) -> ImportedCapture:
    """Write the colour and depth images of a recording into a new capture folder.

    ``fixed_frame``: of the poses, where the recording has some; None for the one that all others
    hang on. CaptureError or CameraError where there is nothing to be made; nothing is left then.
    """
    _require_no_capture(source)
    with new_capture(folder) as draft, open_bag(source) as bag:
        plan = plan_import(bag, named)
        heard = _copied(bag, plan, draft, progress)
        trajectory, frame = _trajectory(plan, draft, heard.tree, fixed_frame)
        draft.finish(plan.camera, trajectory)
        color_images, depth_images = (len(draft.stamps_ns(kind)) for kind in KINDS)
    return ImportedCapture(
        folder,
        plan.color.name,
        plan.depth.name if plan.depth else "",
        plan.camera_info,
        plan.camera,
        color_images,
        depth_images,
        len(trajectory),
        frame,
        tuple(heard.skipped),
        heard.skipped_count,
        heard.other_cameras,
    )


def _require_no_capture(source: Path) -> None:
    reader = recognised(source)
    if reader is not None or is_recording(source):
        what = f"a capture folder ({reader.NAME})" if reader else "a file of Record3D"
        raise CaptureError(
            f"expected a recording at {source}, found {what}, which vnav reads as it is:"
            f" 'vnav build-map {source}'"
        )


def _copied(bag: RosBag, plan: ImportPlan, draft: CaptureDraft, progress: Progress) -> _Heard:
    """Write all images; CaptureError where none of a topic can be."""
    heard, task = _Heard(), f"import {bag.path.name}"
    kinds = {image.name: kind for kind, image in plan.images.items()}
    numbers = dict.fromkeys(kinds, 0)
    total = sum(image.topic.count for image in plan.images.values())
    transforms = [topic.name for topic in bag.of_kind(TRANSFORMS)]
    for name, content in bag.messages([*kinds, plan.camera_info, *transforms]):
        if name not in kinds:
            _hear(heard, name, content, plan)
            continue
        why = _written(kinds[name], content, plan, draft)
        if why is not None:
            heard.skip(numbers[name], name, why)
        numbers[name] += 1
        progress(task, min(sum(numbers.values()), total), total)
    for kind, image in plan.images.items():
        if not draft.stamps_ns(kind):
            first = heard.skipped[0] if heard.skipped else "there is no message"
            raise CaptureError(
                f"expected images in {image.name} of {bag.path}, found none of"
                f" {image.topic.count} that can be used; the first: {first}"
            )
    return heard


def _hear(heard: _Heard, name: str, content: RosMessage | Rejected, plan: ImportPlan) -> None:
    if isinstance(content, tuple):
        heard.tree.add(content, is_static=name.endswith(STATIC))
    elif isinstance(content, RosCameraInfo):
        heard.other_cameras += content != plan.info


def _written(
    kind: str, content: RosMessage | Rejected, plan: ImportPlan, draft: CaptureDraft
) -> Rejected | None:
    """Write one image; why not, where it is damaged or does not fit."""
    if not isinstance(content, RosImage | RosCompressedImage):
        return content if isinstance(content, Rejected) else Rejected("expected an image")
    file = plan.file(kind, content)
    if isinstance(file, Rejected):
        return file
    if file.size != plan.size(kind):
        found, size = file.size, plan.size(kind)
        return Rejected(
            f"expected {size[0]} x {size[1]} pixels, as its camera has, found"
            f" {found[0]} x {found[1]}"
        )
    return draft.add(kind, content.stamp_ns, file.data, file.suffix)


def _trajectory(
    plan: ImportPlan, draft: CaptureDraft, tree: TransformTree, fixed_frame: str | None
) -> tuple[Trajectory, str]:
    """Poses of the colour camera at its images, where the robot moves, and in which frame.

    CaptureError where a frame is named that the camera does not move in.
    """
    frame = plan.color.first.frame
    fixed = fixed_frame or tree.root(frame)
    if not tree.moves(fixed, frame):
        if fixed_frame is not None:
            raise CaptureError(
                f"expected {frame} to move in the fixed frame {fixed_frame}, found that it does"
                f" not; above it are {', '.join(tree.above(frame)) or 'no frames'}"
            )
        return Trajectory(np.zeros(0), np.zeros((0, 4, 4))), ""
    stamps_s = np.array([stamp_ns / 10**9 for stamp_ns in draft.stamps_ns("rgb")])
    T_fixed_camera = tree.poses(fixed, frame, stamps_s)
    known = np.isfinite(T_fixed_camera).all((1, 2))
    return Trajectory(stamps_s[known], T_fixed_camera[known]), fixed
