"""Is a capture fit to be mapped? Asked by ``vnav check`` and before a map is built."""

from dataclasses import asdict, dataclass
from typing import Any

from vnav.checking import rules
from vnav.checking.machine import require_address_space
from vnav.checking.quality import (
    FileFindings,
    FrameFindings,
    TimingFindings,
    look_at_files,
    look_at_frames,
    look_at_times,
)
from vnav.checking.rules import lag_text, shift_text, sizes_text
from vnav.core.camera import Camera
from vnav.core.mapping import overlay_text
from vnav.core.progress import Progress, silent
from vnav.errors import CaptureError
from vnav.io.sources.capture import Capture, FileBacked


@dataclass(frozen=True)
class CaptureReport:
    """What was found in a capture.

    ``files``: None where the frames are not files. ``fatal`` and ``implausible_units`` (None:
    plausible) stop a map, the latter unless forced; ``fitting_units``: units_per_metre that would
    make depth plausible, None where none would; ``corners``: how bright the images' corners are, 1
    in the centre and where the light does not fall off by so much that it is taken off, None where
    that was not measured or cannot be told; ``bands``: of flickering light over an image, 0 where
    there are none, None where that was not measured; ``overlay``: share of the image that shows the
    same in all views, None where that was not measured.
    """

    name: str
    frames: int
    camera: Camera
    files: FileFindings | None
    timing: TimingFindings
    look: FrameFindings | None
    fatal: tuple[str, ...]
    implausible_units: str | None
    fitting_units: float | None
    warnings: tuple[str, ...]
    corners: float | None = None
    bands: float | None = None
    overlay: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON; sizes as "640x480"."""
        values = asdict(self)
        for kind in ("color_sizes", "depth_sizes") if self.files else ():
            sizes = values["files"][kind]
            values["files"][kind] = {f"{w}x{h}": count for (w, h), count in sizes.items()}
        return values


def inspect(capture: Capture, *, progress: Progress = silent) -> CaptureReport:
    """Read every file of a capture, measure its times and some of its frames, and judge them.

    Frames are not decoded where there is no depth, or the files' sizes rule the capture out.
    """
    files = look_at_files(capture, progress) if isinstance(capture, FileBacked) else None
    fatal = rules.no_depth(capture)
    if files is not None:
        fatal += rules.wrong_sizes(capture.camera, files)
    look = None if fatal else look_at_frames(capture, progress)
    fitting = implausible = None
    if look is not None:
        fatal = rules.nothing_seen(look)
        fitting = rules.fitting_units(capture.camera.units_per_metre, look)
        implausible = rules.implausible_units(capture.camera.units_per_metre, look, fitting)
    return CaptureReport(
        capture.name,
        len(capture),
        capture.camera,
        files,
        look_at_times(capture.stamps_s),
        look,
        fatal,
        implausible,
        fitting,
        rules.warnings(capture.stamps_s, files, look),
    )


def problems(report: CaptureReport, *, force: bool = False) -> tuple[str, ...]:
    """What stops a map of this capture; implausible depth units only where not forced."""
    units = report.implausible_units
    return report.fatal if force or units is None else (*report.fatal, units)


def require_depth(capture: Capture) -> None:
    """CaptureError where the capture has no depth."""
    for reason in rules.no_depth(capture):
        raise CaptureError(reason)


def require_usable(
    capture: Capture, *, force: bool = False, progress: Progress = silent
) -> CaptureReport:
    """The report of a capture that can be mapped; CaptureError says why where it cannot.

    VnavError where this machine cannot.
    """
    require_address_space()
    report = inspect(capture, progress=progress)
    found = problems(report, force=force)
    if found:
        raise CaptureError("; ".join(found))
    return report


def summary(report: CaptureReport) -> list[str]:
    """The report for people, line by line; what is wrong is in `problems` and the warnings."""
    files, timing, look = report.files, report.timing, report.look
    frames = f"frames   {report.frames} over {timing.duration_s:.1f} s"
    times = (
        f"times    {timing.median_step_s * 1e3:.0f} ms a frame, largest gap"
        f" {timing.largest_gap_s * 1e3:.0f} ms"
    )
    seen = [] if look is None else _seen(look, report.camera.units_per_metre)
    seen += _light_text(report.corners, report.bands or 0.0)
    if report.overlay:
        seen.append(f"overlay  {overlay_text(report.overlay)}: depth there will be left out")
    if files is None:
        return [f"capture  {report.name}", frames, times, *seen]
    color, depth = sizes_text(files.color_sizes), _depth_text(report.camera, files)
    return [
        f"capture  {report.name}",
        f"{frames}; images without partner: {files.dropped_color} colour,"
        f" {files.dropped_depth} depth",
        f"files    colour {color}; depth {depth}; unreadable: {len(files.unreadable)}",
        f"{times}; depth {files.median_offset_s * 1e3:+.1f} ms from colour, at most"
        f" {files.largest_offset_s * 1e3:+.1f} ms",
        *seen,
        f"truth    {files.truth or 'none'}",
    ]


def _light_text(corners: float | None, bands: float) -> list[str]:
    told = []
    if corners is not None:
        falls = f"falls to {corners:.0%} at the corners: it will be taken off"
        told.append(falls if corners < 1 else "does not fall off by what would harm a map")
    if bands > 0:
        told.append(f"flickers, {bands:.1f} bands to an image: they will be taken off")
    return [f"light    {text}" for text in told]


def _depth_text(camera: Camera, files: FileFindings) -> str:
    registered = "registered" if camera.is_registered else "not registered"
    return f"{sizes_text(files.depth_sizes)}, {registered}" if files.depth_sizes else "none"


def _seen(look: FrameFindings, units_per_metre: float) -> list[str]:
    depth = "none"
    if look.depth_m is not None:
        near, middle, far = look.depth_m
        depth = (
            f"median {middle:.2f} m (+- {1000 * look.depth_noise_m:.0f} mm of noise), nine tenths"
            f" from {near:.2f} to {far:.2f} m"
        )
    return [
        f"depth    {look.valid_depth_share:.0%} of pixels; {depth}"
        f" (units_per_metre = {units_per_metre:g})",
        f"edges    where depth lies: {_where_depth_lies(look)}",
        f"colour   {look.blurred_share:.0%} of frames blurred, {look.dark_share:.0%} dark",
        f"         (depth and colour of {look.sampled} frames, evenly chosen; files: all)",
    ]


def _where_depth_lies(look: FrameFindings) -> str:
    if look.depth_shift:
        return f"{shift_text(look.depth_shift)} of colour"
    return f"on {lag_text(look.depth_lag)}" if look.depth_lag else "cannot be told"
