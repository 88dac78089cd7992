"""Which colour image goes with which depth image: what every reader of image folders finds."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import Camera
from vnav.core.trajectory import Trajectory


@dataclass(frozen=True)
class ImageFile:
    """An image and its time: a file, or a frame of a video."""

    stamp_s: float
    path: Path
    video_frame: int | None = None


@dataclass(frozen=True)
class FramePair:
    """The two images of a frame; no depth in a capture of colour alone.

    ``confidence``: an image of depth's size, 0 where depth is not to be believed. ``camera``: the
    frame's own, where the recorder stored it.
    """

    color: ImageFile
    depth: ImageFile | None
    confidence: ImageFile | None = None
    camera: Camera | None = None

    @property
    def images(self) -> tuple[ImageFile, ...]:
        """Those there are."""
        return tuple(each for each in (self.color, self.depth, self.confidence) if each)

    @property
    def offset_s(self) -> float:
        """How much later depth was taken than colour; 0 without."""
        return self.depth.stamp_s - self.color.stamp_s if self.depth else 0.0


@dataclass(frozen=True)
class FrameList:
    """The frames of a capture in order of time, and the images that found no partner.

    ``poses``: those of the colour camera that the recorder knew, in a world whose z points up.
    """

    pairs: tuple[FramePair, ...]
    dropped_color: tuple[ImageFile, ...] = ()
    dropped_depth: tuple[ImageFile, ...] = ()
    poses: Trajectory | None = None

    @property
    def has_depth(self) -> bool:
        """Whether its frames have depth: all have, or none."""
        return self.pairs[0].depth is not None

    @property
    def camera(self) -> Camera | None:
        """The first frame's own, None where frames have none."""
        return self.pairs[0].camera

    def with_cameras(self, change: Callable[[Camera], Camera]) -> "FrameList":
        """The same frames, the camera of each changed, where they have their own."""
        pairs = (
            dataclasses.replace(pair, camera=change(pair.camera)) if pair.camera else pair
            for pair in self.pairs
        )
        return dataclasses.replace(self, pairs=tuple(pairs))

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Times (N,) of the colour images."""
        return np.array([pair.color.stamp_s for pair in self.pairs])

    @property
    def offsets_s(self) -> NDArray[np.float64]:
        """How much later (N,) each depth image was taken than its colour image; (0,) without."""
        return np.array([pair.offset_s for pair in self.pairs if pair.depth])


def paired(
    colors: Sequence[ImageFile], depths: Sequence[ImageFile], matches: NDArray[np.intp]
) -> FrameList:
    """The frame list that matches (M, 2), rows of colour and depth, make; the rest is dropped.

    Of several colour images with the same time the first is kept.
    """
    by_stamp: dict[float, FramePair] = {}
    for color, depth in matches:
        by_stamp.setdefault(colors[color].stamp_s, FramePair(colors[color], depths[depth]))
    pairs = tuple(by_stamp[stamp] for stamp in sorted(by_stamp))
    used = {image.path for pair in pairs for image in pair.images}
    return FrameList(
        pairs,
        tuple(image for image in colors if image.path not in used),
        tuple(image for image in depths if image.path not in used),
    )


def unpaired(colors: Sequence[ImageFile]) -> FrameList:
    """The frame list of colour images alone; of several with the same time the first is kept."""
    by_stamp: dict[float, FramePair] = {}
    for color in colors:
        by_stamp.setdefault(color.stamp_s, FramePair(color, None))
    return FrameList(tuple(by_stamp[stamp] for stamp in sorted(by_stamp)))
