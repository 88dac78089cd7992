"""Which topics of a bag a capture is made of: named, or found by what their messages hold.

Conventions: REP 104 and image_pipeline (camera_info beside its images), image_transport (the name
of a compressed image below that of the raw one), the names of depth that is registered to colour
in realsense-ros (aligned_depth_to_color) and in openni_launch (depth_registered).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from vnav.errors import CaptureError
from vnav.io.recordings.ros_bag import CAMERA_INFO, COMPRESSED, IMAGE, RosBag, RosTopic
from vnav.io.recordings.ros_images import is_color, is_depth
from vnav.io.recordings.ros_messages import AnyImage, RosCameraInfo, RosCompressedImage, RosImage

_TRANSPORTS = ("/compressed", "/compressedDepth")
_REGISTERED = ("aligned_depth_to_color", "depth_registered")


@dataclass(frozen=True)
class TopicNames:
    """What a user says of topics; None: to be found."""

    color: str | None = None
    depth: str | None = None
    camera_info: str | None = None  # of colour
    is_registered: bool = False  # that depth lies on the pixels of colour, whatever else says


@dataclass(frozen=True)
class ImageTopic:
    """A topic of images, and the first of them."""

    topic: RosTopic
    first: AnyImage

    @property
    def name(self) -> str:
        """Its name."""
        return self.topic.name

    @property
    def plain_name(self) -> str:
        """The name of the same images before they were compressed."""
        ending = next((end for end in _TRANSPORTS if self.name.endswith(end)), "")
        return self.name.removesuffix(ending)

    @property
    def is_rectified(self) -> bool:
        """Whether its images are undistorted, as their name says."""
        return "image_rect" in self.plain_name.rpartition("/")[2]

    @property
    def is_registered(self) -> bool:
        """Whether it is depth that lies on the pixels of colour, as its name says."""
        return any(name in self.plain_name.split("/") for name in _REGISTERED)


def choose_images(bag: RosBag, named: TopicNames) -> tuple[ImageTopic, ImageTopic | None]:
    """The topics of colour and of depth, None where the bag has no depth.

    CaptureError where there is no colour, or several topics may be meant.
    """
    images = _image_topics(bag)
    color = _chosen(bag, images, named.color, "color", _color_rank)
    if color is None:
        raise CaptureError(f"expected images in {bag.path}, found {_listed(bag.topics)}")

    def depth_rank(image: ImageTopic) -> int | None:
        is_near = image.is_registered or image.first.frame == color.first.frame
        return int(not is_near) if is_depth(image.first) else None

    others = [image for image in images if image.name != color.name]
    return color, _chosen(bag, others, named.depth, "depth", depth_rank)


def choose_camera_info(
    bag: RosBag, image: ImageTopic, named: str | None = None
) -> tuple[str, RosCameraInfo]:
    """Topic and first message of the camera of some images: named, or as `find_camera_info`.

    CaptureError where there is none.
    """
    topics = bag.of_kind(CAMERA_INFO)
    if named is not None:
        info = bag.first(named)
        if not isinstance(info, RosCameraInfo):
            raise _not_there(bag, named, "camera-info", topics)
        return named, info
    found = find_camera_info(bag, image)
    if found is None:
        raise CaptureError(
            f"expected a topic camera_info beside {image.name} in {bag.path}, found"
            f" {_listed(topics)}; name the one of colour with --camera-info TOPIC"
        )
    return found


def find_camera_info(bag: RosBag, image: ImageTopic) -> tuple[str, RosCameraInfo] | None:
    """Topic and first message of the camera beside some images, or of their frame; None without."""
    firsts = [(topic.name, bag.first(topic.name)) for topic in bag.of_kind(CAMERA_INFO)]
    infos = {name: info for name, info in firsts if isinstance(info, RosCameraInfo)}
    beside = f"{image.plain_name.rpartition('/')[0]}/camera_info"
    same_frame = [name for name, info in infos.items() if info.frame == image.first.frame]
    if beside in infos:
        return beside, infos[beside]
    return (same_frame[0], infos[same_frame[0]]) if len(same_frame) == 1 else None


def _image_topics(bag: RosBag) -> list[ImageTopic]:
    firsts = [(topic, bag.first(topic.name)) for topic in bag.of_kind(IMAGE, COMPRESSED)]
    return [
        ImageTopic(topic, first)
        for topic, first in firsts
        if isinstance(first, RosImage | RosCompressedImage)
    ]


def _color_rank(image: ImageTopic) -> int | None:
    """Colour before grey, which is mostly infrared; no depth."""
    return None if is_depth(image.first) else int(not is_color(image.first))


def _chosen(
    bag: RosBag,
    images: Sequence[ImageTopic],
    named: str | None,
    option: str,
    rank: Callable[[ImageTopic], int | None],
) -> ImageTopic | None:
    """The image topic of a name, or the one of the best rank; None where none has a rank."""
    if named is not None:
        found = next((image for image in images if image.name == named), None)
        if found is None:
            raise _not_there(bag, named, option, [image.topic for image in images])
        return found
    best = _best(images, rank)
    if len(best) > 1:
        raise CaptureError(
            f"expected one topic of {option} images in {bag.path}, found"
            f" {_listed([image.topic for image in best])}; name one with --{option} TOPIC"
        )
    return best[0] if best else None


def _best(
    images: Sequence[ImageTopic], rank: Callable[[ImageTopic], int | None]
) -> list[ImageTopic]:
    """Those of the best rank; of a topic and the same compressed, the raw one."""
    ranks = [(n, image) for image in images if (n := rank(image)) is not None]
    best = min((n for n, _ in ranks), default=None)
    alike = {image.name: image for n, image in ranks if n == best}
    return [i for name, i in alike.items() if name == i.plain_name or i.plain_name not in alike]


def _not_there(bag: RosBag, named: str, option: str, known: Sequence[RosTopic]) -> CaptureError:
    return CaptureError(
        f"expected the topic {named} of --{option} in {bag.path}, found {_listed(known)}"
    )


def _listed(topics: Sequence[RosTopic]) -> str:
    """Names and numbers of messages, for people."""
    return ", ".join(f"{topic.name} ({topic.count})" for topic in topics) or "none"
