"""What the measures of a capture say: what stops a map, and what a person should know."""

import numpy as np

from vnav.checking.depth_lag import DepthLag
from vnav.checking.depth_shift import DepthShift
from vnav.checking.quality import FileFindings, FrameFindings, Size
from vnav.core.arrays import Array
from vnav.core.camera import Camera
from vnav.io.sources.capture import Capture

# Where the depth of indoor captures lies, in metres: its nearest twentieth, its middle, its
# farthest twentieth. Depth cameras begin at 0.2 m or later and reach 10 m at most.
NEAREST_M, MEDIAN_M, FARTHEST_M = 0.2, (0.4, 6.0), 10.0
USUAL_UNITS = (1000, 5000, 10000, 4000, 100)  # per metre, the most common first

MANY_DROPPED, LITTLE_DEPTH, MANY_POOR = 0.1, 0.1, 0.3  # shares that are worth a warning
NAMED = 10  # damaged files, before the others are counted
CORRECT_SIZE = "correct its width and height, or name another camera"
ADD_SIZE = "add its width and height to [depth] of the camera"
FAR_OFF = 1 / 100  # of the image's width, that depth may lie beside colour: 6 px at 640
CLEAR = 3  # standard deviations
LATE_S = 0.05  # of depth beside colour: less is found and taken off when the map is made
LONG_GAP_S, LONG_GAP_STEPS = 0.5, 10  # a gap longer than both is worth one too


def no_depth(capture: Capture) -> tuple[str, ...]:
    """Why a capture without depth cannot be mapped; nothing where it has depth."""
    if capture.has_depth:
        return ()
    return (
        f"expected frames with depth, found {capture.name} with colour only; a map needs a depth"
        " image for each colour image: record with an RGB-D camera, or add the depth; without, only"
        " 'vnav odometry CAPTURE --config mono' works",
    )


def wrong_sizes(camera: Camera, files: FileFindings) -> tuple[str, ...]:
    """What is wrong with the images' sizes: none readable, several mixed, not the camera's."""
    if camera.depth is None:
        of_depth = camera.color.size, "like colour's", ADD_SIZE
    else:
        of_depth = camera.depth.size, "as [depth] of the camera says", CORRECT_SIZE
    of_color = camera.color.size, "as [color] of the camera says", CORRECT_SIZE
    kinds = ("colour", files.color_sizes, *of_color), ("depth", files.depth_sizes, *of_depth)
    wrong = []
    for kind, sizes, (width, height), why, mend in kinds:
        if len(sizes) > 1:
            wrong.append(
                f"expected {kind} images of one size, found {sizes_text(sizes)}; remove"
                f" {files.odd_sizes[0]}" + ", and the others" * (len(files.odd_sizes) > 1)
            )
        elif not sizes:
            wrong.append(f"expected {kind} images, found none that can be read")
        elif (width, height) not in sizes:
            wrong.append(
                f"expected {kind} images of {width} x {height}, {why}, found {sizes_text(sizes)};"
                f" {mend}"
            )
    return tuple(wrong)


def nothing_seen(look: FrameFindings) -> tuple[str, ...]:
    """What makes every frame useless: none can be read, or no depth in any."""
    if len(look.unreadable) == look.sampled:
        return (f"none of {look.sampled} frames could be read; the first: {look.unreadable[0]}",)
    if look.depth_m is None:
        return (f"expected depth in the depth images, found only zeros in {look.sampled} frames",)
    return ()


def _is_plausible(look: FrameFindings, factor: float) -> bool:
    if look.depth_m is None:
        return True
    near, middle, far = (factor * depth for depth in look.depth_m)
    return near >= NEAREST_M and MEDIAN_M[0] <= middle <= MEDIAN_M[1] and far <= FARTHEST_M


def fitting_units(used: float, look: FrameFindings) -> float | None:
    """The camera's units_per_metre if depth is plausible, else a usual value that makes it so."""
    fitting = (units for units in (used, *USUAL_UNITS) if _is_plausible(look, used / units))
    return next(fitting, None)


def implausible_units(used: float, look: FrameFindings, fitting: float | None) -> str | None:
    """Why the depths of a room cannot be these, None where they can."""
    if look.depth_m is None or fitting == used:
        return None
    near, middle, far = look.depth_m
    hint = f"{fitting:g} would fit" if fitting else "none of the usual values would fit"
    return (
        f"expected indoor depth, found a median of {middle:.3g} m and nine tenths from {near:.3g}"
        f" to {far:.3g} m: units_per_metre = {used:g} is probably wrong, {hint}; correct the camera"
        " or use --set capture.units_per_metre=...; if it is right, use 'vnav build-map --force'"
    )


def warnings(
    stamps_s: Array, files: FileFindings | None, look: FrameFindings | None
) -> tuple[str, ...]:
    """What does not stop a map, but may spoil it; of very many damaged files the first."""
    damaged = [] if files is None else list(files.unreadable)
    damaged += [] if look is None else look.unreadable
    damaged = list(dict.fromkeys(damaged))
    found = damaged[:NAMED]
    if len(damaged) > NAMED:
        found.append(f"{len(damaged) - NAMED} more cannot be read; 'vnav check --json' names them")
    found += [] if files is None else _of_files(files, len(stamps_s))
    offset_s = 0.0 if files is None else files.median_offset_s
    found += [*_of_times(stamps_s), *([] if look is None else _of_look(look, offset_s))]
    return tuple(dict.fromkeys(found))


def _of_files(files: FileFindings, count: int) -> list[str]:
    found, dropped = [], max(files.dropped_color, files.dropped_depth)
    if dropped > MANY_DROPPED * (count + dropped):
        found.append(
            f"{dropped} images have no partner in time, {count} have one; are colour and depth of"
            " the same recording and by the same clock?"
        )
    repeated = files.repeated
    if repeated.has_slow_camera:
        found.append(
            f"{len(repeated.color) + len(repeated.depth)} of {count} frames have the colour or the"
            " depth image of the frame before, and will be left out; record colour and depth at one"
            " rate"
        )
    if repeated.has_stalled:
        found.append(
            f"{len(repeated.both)} of {count} frames are the frame before once more; if the"
            " camera moved meanwhile, the recording stalled, and their poses are late"
        )
    return found


def _of_times(stamps_s: Array) -> list[str]:
    steps_s = np.diff(stamps_s)
    if len(steps_s) < 2 or steps_s.max() <= max(LONG_GAP_S, LONG_GAP_STEPS * np.median(steps_s)):
        return []
    k = int(steps_s.argmax())
    return [f"no frames for {steps_s[k]:.1f} s after frame {k} ({stamps_s[k]:.3f} s)"]


def _of_look(look: FrameFindings, offset_s: float) -> list[str]:
    found = []
    if 0 < look.valid_depth_share < LITTLE_DEPTH:
        found.append(f"only {look.valid_depth_share:.1%} of the pixels have depth")
    if look.blurred_share > MANY_POOR:
        found.append(f"{look.blurred_share:.0%} of the frames are blurred; move more slowly")
    if look.dark_share > MANY_POOR:
        found.append(f"{look.dark_share:.0%} of the frames are dark; give more light")
    return [*found, *_of_registration(look.depth_shift), *_of_lag(look.depth_lag, offset_s)]


def _of_registration(shift: DepthShift | None) -> list[str]:
    if shift is None:
        return []
    off_px, sigma_px = np.hypot(*shift.px), np.hypot(*shift.sigma_px)
    if off_px < max(FAR_OFF * shift.width, CLEAR * sigma_px):
        return []
    return [
        f"edges of depth lie {shift_text(shift)} from those of colour; is depth registered as the"
        " camera says, are both of one moment? 'vnav check CAPTURE --png edges.png' shows them"
    ]


def _of_lag(lag: DepthLag | None, offset_s: float) -> list[str]:
    """``offset_s``: of depth's stamps, in pairs, from colour's."""
    if lag is None or abs(lag.time_s) <= LATE_S:
        return []
    return [
        f"depth belongs with {lag_text(lag)}; were pairs shifted by a line, do both have one clock?"
        f" Add {-lag.time_s - offset_s:.3f} s to depth's time stamps, or record anew"
    ]


def lag_text(lag: DepthLag) -> str:
    """The colour that depth belongs with, for people."""
    count, way = abs(lag.frames), "before" if lag.frames > 0 else "after"
    frames = "the frame" if count == 1 else f"{count} frames"
    return f"the colour of {frames} {way} it, by {abs(lag.time_s):.3f} s"


def shift_text(shift: DepthShift) -> str:
    """How far and where to, for people."""
    (x, y), (sigma_x, sigma_y) = shift.px, shift.sigma_px
    across, down = "right" if x > 0 else "left", "below" if y > 0 else "above"
    return (
        f"{abs(x):.1f} px {across} (+- {sigma_x:.1f}) and {abs(y):.1f} px {down} (+- {sigma_y:.1f})"
    )


def sizes_text(sizes: dict[Size, int]) -> str:
    """Sizes and how many images have them, for people."""
    return ", ".join(f"{count} of {w} x {h}" for (w, h), count in sizes.items()) or "none"
