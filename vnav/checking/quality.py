"""What can be measured about a capture before anything is made of it."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.checking.depth_lag import DepthLag, depth_lag, lagging_profiles, rows_to_compare
from vnav.checking.depth_shift import DepthShift, EdgeProfiles, depth_shift, edge_profiles
from vnav.core.arrays import Array
from vnav.core.depth_planes import depth_noise
from vnav.core.frame import Frame
from vnav.core.progress import Progress
from vnav.errors import CaptureError
from vnav.io.formats.images import image_size
from vnav.io.formats.video import video_size
from vnav.io.sources.capture import Capture, FileBacked
from vnav.io.sources.frame_list import ImageFile
from vnav.io.sources.repeats import Repeats, repeats

SAMPLES = 60  # frames that are decoded and measured, evenly over the capture
BLURRED, DARK = 0.6, 40.0  # from about 8 px of smear at 640 px width; mean grey level of 255

NOISE_REACH_PX = 4  # of the planes that depth is noisy about

Size = tuple[int, int]  # width, height
Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class FileFindings:
    """Every image file of the frames.

    How many whole ones of which size, the commonest first; names of those of another size than
    the commonest; what is wrong with the damaged ones; how many images found no partner; how much
    later depth was taken than colour, 0 without depth; the file of the true trajectory; which
    images come twice.
    """

    color_sizes: dict[Size, int]
    depth_sizes: dict[Size, int]
    odd_sizes: tuple[str, ...]
    unreadable: tuple[str, ...]
    dropped_color: int
    dropped_depth: int
    median_offset_s: float
    largest_offset_s: float
    truth: str | None
    repeated: Repeats


@dataclass(frozen=True)
class TimingFindings:
    """Times of the frames; the step and the gap are 0 where there is one frame only."""

    duration_s: float
    median_step_s: float
    largest_gap_s: float


@dataclass(frozen=True)
class FrameFindings:
    """Depth and colour of the sampled frames.

    ``depth_m``: medians over the frames of their 5th, 50th and 95th percentile of depth, None
    where there was no depth at all. ``depth_noise_m``: its standard deviation at the median depth,
    steps of the sensor included; it grows with depth squared. ``depth_shift``: None where edges do
    not tell; then ``depth_lag``: the frame whose colour it belongs with, None where that is its
    own.
    """

    sampled: int
    unreadable: tuple[str, ...]
    valid_depth_share: float
    depth_m: tuple[float, float, float] | None
    depth_noise_m: float
    blurred_share: float
    dark_share: float
    depth_shift: DepthShift | None
    depth_lag: DepthLag | None = None


def look_at_files(capture: FileBacked, progress: Progress) -> FileFindings:
    """Read every file whole; one that is missing, cut off or altered is named."""
    files = capture.files
    count = len(files.pairs)
    images = [pair.color for pair in files.pairs]
    images += [pair.depth for pair in files.pairs if pair.depth is not None]
    files_of = list({image.path: image for image in images}.values())
    found = _in_threads(_size_of, files_of, "reading files", progress)
    size_of = dict(zip((image.path for image in files_of), found, strict=True))
    sizes = [size_of[image.path] for image in images]
    color, odd_color = _counted(images[:count], sizes[:count])
    depth, odd_depth = _counted(images[count:], sizes[count:])
    return FileFindings(
        color,
        depth,
        (*odd_color, *odd_depth),
        tuple(str(size) for size in sizes if isinstance(size, CaptureError)),
        len(files.dropped_color),
        len(files.dropped_depth),
        float(np.median(files.offsets_s)) if files.has_depth else 0.0,
        float(max(files.offsets_s, key=abs, default=0.0)),
        None if capture.truth is None else capture.truth.name,
        repeats(files.pairs),
    )


def look_at_times(stamps_s: Array) -> TimingFindings:
    """Steps between the frames' times (N,), N at least 1."""
    steps_s = np.diff(stamps_s)
    return TimingFindings(
        float(stamps_s[-1] - stamps_s[0]),
        float(np.median(steps_s)) if len(steps_s) else 0.0,
        float(steps_s.max(initial=0.0)),
    )


def look_at_frames(capture: Capture, progress: Progress) -> FrameFindings:
    """Decode frames spread evenly over the capture and measure them."""
    count = min(SAMPLES, len(capture))
    rows = np.linspace(0, len(capture) - 1, count).round().astype(int)

    def measure(row: int) -> tuple[NDArray[np.float64], EdgeProfiles] | CaptureError:
        try:
            frame = capture.read(row)
            return _measures(frame), edge_profiles(frame)
        except CaptureError as error:
            return error

    found = list(_in_threads(measure, rows.tolist(), "measuring frames", progress))
    read = [each for each in found if not isinstance(each, CaptureError)]
    measures = np.array([values for values, _ in read]).reshape(-1, 7)
    seen = measures[measures[:, 0] > 0, 1:5]
    near, middle, far, noise = np.median(seen, 0).tolist() if len(seen) else [0.0] * 4
    share, blurred, dark = (float(x) for x in _shares(measures))
    shift = depth_shift([profiles for _, profiles in read])
    return FrameFindings(
        len(rows),
        tuple(str(row) for row in found if isinstance(row, CaptureError)),
        share,
        (near, middle, far) if len(seen) else None,
        noise * middle**2,
        blurred,
        dark,
        shift,
        _lag(capture, progress) if shift is None else None,
    )


def _lag(capture: Capture, progress: Progress) -> DepthLag | None:
    """Of depth behind colour, by frames that can be read with their neighbours."""

    def measure(row: int) -> list[EdgeProfiles] | None:
        try:
            return lagging_profiles(capture, row)
        except CaptureError:
            return None

    rows = rows_to_compare(len(capture))
    found = list(_in_threads(measure, rows, "comparing times", progress))
    step_s = look_at_times(capture.stamps_s).median_step_s
    return depth_lag([profiles for profiles in found if profiles], step_s)


def blur(gray: NDArray[np.uint8]) -> float:
    """How smeared an image (H, W) is along its worse axis, 0 sharp to 1: what blurring it changes.

    Source: Crete, Dolmiere, Ladret, Nicolas 2007, measured at 640 px width, and at a quarter of it,
    where the steps of grey levels that are all the edges heavy blur leaves are gone. 0 on a blank
    image.
    """
    width = min(640, gray.shape[1])
    images = [_narrowed(gray, w).astype(np.float32) for w in (width, -(-width // 4))]
    return max(_smear(image, axis) for image in images for axis in (0, 1))


def _narrowed(gray: NDArray[np.uint8], width: int) -> NDArray[Any]:
    size = width, max(1, round(gray.shape[0] * width / gray.shape[1]))
    return np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA))


def _smear(image: NDArray[np.float32], axis: int) -> float:
    again = cv2.blur(image, (1, 9) if axis == 0 else (9, 1))
    steps, steps_again = (np.abs(np.diff(values, axis=axis)) for values in (image, again))
    total = float(steps.sum())
    return 1 - float(np.maximum(steps - steps_again, 0).sum()) / total if total else 0.0


def _measures(frame: Frame) -> NDArray[np.float64]:
    """Share of valid depth, its 5th, 50th and 95th percentile, noise, blur, mean grey level.

    Noise is that of inverse depth, 1/m.
    """
    gray = cv2.cvtColor(np.asarray(frame.color), cv2.COLOR_RGB2GRAY)
    valid = frame.depth_m[frame.depth_m > 0]
    depths_m = np.percentile(valid, (5, 50, 95)) if len(valid) else (0.0, 0.0, 0.0)
    noise = depth_noise(frame.depth_m, NOISE_REACH_PX)
    return np.array([valid.size / frame.depth_m.size, *depths_m, noise, blur(gray), gray.mean()])


def _shares(measures: NDArray[np.float64]) -> tuple[float, float, float]:
    if not len(measures):
        return 0.0, 0.0, 0.0
    is_blurred, is_dark = measures[:, 5] > BLURRED, measures[:, 6] < DARK
    return measures[:, 0].mean(), is_blurred.mean(), is_dark.mean()


def _size_of(image: ImageFile) -> Size | CaptureError:
    try:
        is_film = image.video_frame is not None
        return video_size(image.path) if is_film else image_size(image.path)
    except CaptureError as error:
        return error


def _counted(
    images: Sequence[ImageFile], sizes: Sequence[Size | CaptureError]
) -> tuple[dict[Size, int], list[str]]:
    pairs = zip(sizes, images, strict=True)
    whole = [(size, image.path) for size, image in pairs if isinstance(size, tuple)]
    counts = dict(Counter(size for size, _ in whole).most_common())
    return counts, [str(path) for size, path in whole if size != next(iter(counts))]


def _in_threads(
    work: Callable[[Item], Result], items: Sequence[Item], task: str, progress: Progress
) -> Iterator[Result]:
    with ThreadPoolExecutor() as pool:
        for done, result in enumerate(pool.map(work, items), 1):
            yield result
            progress(task, done, len(items))
