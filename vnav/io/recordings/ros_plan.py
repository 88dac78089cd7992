"""What is read of a bag, and by which camera: settled before anything is written."""

import re
from dataclasses import dataclass

import numpy as np

from vnav.core.arrays import Array
from vnav.core.camera import Camera, Intrinsics
from vnav.core.frame import Rejected
from vnav.errors import CameraError, CaptureError
from vnav.io.recordings.ros_bag import TRANSFORMS, RosBag
from vnav.io.recordings.ros_camera import camera_of, intrinsics_of
from vnav.io.recordings.ros_images import (
    MILLIMETRES,
    EncodedImage,
    color_file,
    depth_file,
    units_per_metre,
)
from vnav.io.recordings.ros_messages import AnyImage, RosCameraInfo
from vnav.io.recordings.ros_topics import (
    ImageTopic,
    TopicNames,
    choose_camera_info,
    choose_images,
    find_camera_info,
)
from vnav.io.recordings.transform_tree import TransformTree

_LIBREALSENSE = re.compile(r"/device_\d+/sensor_\d+/")  # its src/media/ros/ros_file_format.h
STATIC = "tf_static"  # how the topic of transforms that hold for ever ends


@dataclass(frozen=True)
class ImportPlan:
    """Which topics are read, and the camera that their images must fit."""

    color: ImageTopic
    depth: ImageTopic | None
    camera_info: str
    info: RosCameraInfo
    camera: Camera

    @property
    def images(self) -> dict[str, ImageTopic]:
        """Topics by the folder that their images go to."""
        return {"rgb": self.color} | ({"depth": self.depth} if self.depth else {})

    def size(self, kind: str) -> tuple[int, int]:
        """Width and height of the images of a folder."""
        sensor = self.camera.depth or self.camera.color
        return (sensor if kind == "depth" else self.camera.color).size

    def file(self, kind: str, image: AnyImage) -> EncodedImage | Rejected:
        """An image of a folder as a file, whatever its size; Rejected where it is damaged."""
        known = self.images[kind].first.encoding
        if image.encoding != known:
            return Rejected(f"expected {known}, as the images before, found {image.encoding}")
        return color_file(image) if kind == "rgb" else depth_file(image, self.size(kind))


def plan_import(bag: RosBag, named: TopicNames) -> ImportPlan:
    """Topics and camera, checked on the first image of each.

    CaptureError or CameraError where no capture can be made of the bag.
    """
    _require_ros(bag)
    color, depth = choose_images(bag, named)
    topic, info = choose_camera_info(bag, color, named.camera_info)
    camera = Camera(intrinsics_of(info, topic, is_rectified=color.is_rectified), MILLIMETRES)
    if depth is not None:
        camera = _with_depth(bag, camera.color, color, depth, named.is_registered)
    plan = ImportPlan(color, depth, topic, info, camera)
    for kind, image in plan.images.items():
        size, file = plan.size(kind), plan.file(kind, image.first)
        if isinstance(file, EncodedImage) and file.size != size:
            raise CameraError(
                f"expected {kind} images of {size[0]} x {size[1]} pixels in {image.name} of"
                f" {bag.path}, as {topic} says, found {file.size[0]} x {file.size[1]}; name another"
                " camera with --camera-info TOPIC"
            )
    return plan


def _require_ros(bag: RosBag) -> None:
    """CaptureError for librealsense's recordings, which are bags with no frames and other depth."""
    if any(_LIBREALSENSE.match(topic.name) for topic in bag.topics):
        raise CaptureError(
            f"expected a bag that ROS recorded, found one of librealsense (realsense-viewer) in"
            f" {bag.path}; Open3D makes a capture folder of it: python -c 'import open3d;"
            f' open3d.t.io.RSBagReader.create("{bag.path}").save_frames("FOLDER")\''
        )


def _with_depth(
    bag: RosBag, intrinsics: Intrinsics, color: ImageTopic, depth: ImageTopic, is_registered: bool
) -> Camera:
    """The camera of colour and depth; CaptureError where nobody tells where depth was seen from."""
    units, frames = units_per_metre(depth.first), (color.first.frame, depth.first.frame)
    if is_registered or depth.is_registered or frames[0] == frames[1] != "":
        found = find_camera_info(bag, depth)
        T_color_depth = np.eye(4)
    else:
        found = choose_camera_info(bag, depth)
        T_color_depth = _extrinsics(bag, *frames)
    own = found and intrinsics_of(found[1], found[0], is_rectified=depth.is_rectified)
    return camera_of(intrinsics, own, T_color_depth, units)


def _extrinsics(bag: RosBag, color_frame: str, depth_frame: str) -> Array:
    """T_color_depth (4, 4) by the robot's frames, read until they are connected."""
    tree = TransformTree()
    for name, content in bag.messages([topic.name for topic in bag.of_kind(TRANSFORMS)]):
        if isinstance(content, tuple):
            tree.add(content, is_static=name.endswith(STATIC))
        if tree.knows(color_frame, depth_frame):
            return tree.at_first(color_frame, depth_frame)
    raise CaptureError(
        f"expected a transform between {color_frame or 'no frame'}, of colour, and"
        f" {depth_frame or 'no frame'}, of depth, in {bag.path}, found none; where depth"
        " lies on the pixels of colour, say so with --registered, or name such depth with --depth"
    )
