"""A capture folder that is made whole or not at all: TUM RGB-D layout and a camera.toml."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from vnav.core.camera import Camera
from vnav.core.frame import Rejected
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError
from vnav.io.formats.camera_file import camera_text
from vnav.io.formats.trajectories import write_tum

KINDS = ("rgb", "depth")  # folders of images
TRAJECTORY = "trajectory.tum"  # of poses that the recording knows; no truth


class CaptureDraft:
    """Images are written as they come; `finish` writes their lists and the camera."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._names: dict[str, dict[int, str]] = {kind: {} for kind in KINDS}
        for kind in KINDS:
            (root / kind).mkdir(parents=True)

    def add(self, kind: str, stamp_ns: int, data: bytes, suffix: str) -> Rejected | None:
        """Write an image file of "rgb" or "depth"; why not, where no image can have its time."""
        names = self._names[kind]
        if stamp_ns < 0 or stamp_ns in names:
            why = "before 1970" if stamp_ns < 0 else "that of an image before"
            return Rejected(f"expected the time of an image, found {_seconds(stamp_ns)} s, {why}")
        names[stamp_ns] = f"{kind}/{_seconds(stamp_ns)}{suffix}"
        (self.root / names[stamp_ns]).write_bytes(data)
        return None

    def stamps_ns(self, kind: str) -> list[int]:
        """Times of the images so far, ascending."""
        return sorted(self._names[kind])

    def finish(self, camera: Camera, trajectory: Trajectory) -> None:
        """Write what else a capture has; depth.txt and trajectory only where there are some."""
        for kind, names in self._names.items():
            if not names:
                (self.root / kind).rmdir()
                continue
            lines = [f"{_seconds(stamp_ns)} {names[stamp_ns]}" for stamp_ns in sorted(names)]
            text = "\n".join(["# timestamp filename", *lines, ""])
            (self.root / f"{kind}.txt").write_text(text, "utf-8")
        (self.root / "camera.toml").write_text(f"{camera_text(camera)}\n", "utf-8")
        if len(trajectory):
            write_tum(self.root / TRAJECTORY, trajectory)


@contextmanager
def new_capture(folder: Path) -> Iterator[CaptureDraft]:
    """A draft that becomes the folder when the block ends without an error, and else is removed.

    CaptureError where the folder is there already, or cannot be written.
    """
    if folder.exists() or folder.is_symlink():
        raise CaptureError(
            f"expected to write a new folder {folder}, found that it is there already; remove it or"
            " name another"
        )
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder.parent, prefix=".", suffix=".draft") as scratch:
            draft = CaptureDraft(Path(scratch) / "capture")
            yield draft
            draft.root.rename(folder)
    except OSError as error:
        raise CaptureError(
            f"expected to write a capture to {folder}, found: {error.strerror}; make room there,"
            " give write permission, or name another folder"
        ) from error


def _seconds(stamp_ns: int) -> str:
    return f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}"
