"""Writing a scene as a capture: TUM folder, exact truth, photos by a second camera."""

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.caches import user_cache
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.grid import FREE
from vnav.core.progress import Progress, silent
from vnav.errors import CaptureError
from vnav.io.formats.grid_files import write_grid
from vnav.synthetic.masks import write_masks
from vnav.synthetic.path import Hand, look, trembling, walk
from vnav.synthetic.people import Mover, Peopled, peopled
from vnav.synthetic.scene import Scene
from vnav.synthetic.scenes import SCENES
from vnav.synthetic.sensor import Sensor, gains, measured_color, measured_depth
from vnav.synthetic.shutter import exposed_color
from vnav.synthetic.staying import MOTIONS, stay
from vnav.synthetic.strolls import STEP_S
from vnav.synthetic.things import THINGS, thing_before

UNITS_PER_METRE = 5000
FIRST_STAMP_S = 1000.0
DEPTH_LAG_S = 0.004  # the depth camera exposes a little later; what it sees is written as of now
PACE_S = 1.6  # a walk of uneven steps quickens and slows once in that time
GRID_M = 0.05
OBSTACLES_M = 0.10, 1.40  # what stands between these heights is in the way
PHOTO_CLEARANCE_M = 0.4
NEAREST_VIEW_M = 1.5  # median depth of a photo is no less


@dataclass(frozen=True)
class CaptureSpec:
    """What to record: a scene's name, how many frames and photos, by which cameras.

    ``walkers`` people walk about and cover ``walker_share`` of the pixels, the mean over frames.
    Everything else is as without them: poses, noise, photos.
    """

    scene: str
    frames: int
    photos: int
    camera: Intrinsics
    photo_camera: Intrinsics
    rate_hz: float = 10.0
    height_m: float = 1.3
    pitch_deg: float = -18.0
    pan_deg: float = 0.0  # to either side
    pan_s: float = 2.0  # there and back
    tremor_deg: float = 0.0  # at most, about each axis
    roll_deg: float = 0.0  # at most, to either side and slowly
    motion: str = ""  # of a camera that stays where the tour begins, of `staying.MOTIONS`
    walkers: int = 0
    walker_share: float = 0.2
    thing: str = ""  # a thing that moves before where the tour begins, of `things.THINGS`
    uneven: float = 0.0  # share by which the step from frame to frame grows and shrinks
    seed: int = 0
    sensor: Sensor = Sensor()
    name: str = "capture"  # of its folder in the cache


KINECT = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
PHONE = Intrinsics(800, 600, 655.0, 655.0, 403.2, 297.4)
DEMO = CaptureSpec("apartment", 200, 12, KINECT, PHONE, name="apartment")
MINIATURE = CaptureSpec(
    "one_room",
    60,
    4,
    KINECT.scaled(320, 240),
    PHONE,
    rate_hz=5.0,
    height_m=1.1,
    pitch_deg=-20.0,
    name="miniature",
)
HANDHELD = CaptureSpec(
    "one_room",
    300,
    12,
    KINECT,
    PHONE,
    rate_hz=30.0,
    height_m=1.1,
    pitch_deg=-20.0,
    pan_deg=24.0,
    sensor=Sensor(exposure_s=0.008, line_delay_s=5e-5, depth_delay_s=0.02),
    name="handheld",
)


def cached_capture(
    spec: CaptureSpec, cache: Path | None = None, progress: Progress = silent
) -> Path:
    """Folder of the capture, written if this specification was not yet written by this code.

    ``cache`` is ``$XDG_CACHE_HOME/vnav`` (``~/.cache/vnav``) unless given; CaptureError where it
    cannot be written.
    """
    cache = cache or user_cache()
    folder = cache / _fingerprint(spec) / spec.name
    if folder.is_dir():
        return folder
    try:
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache) as draft:
            write_capture(Path(draft) / "whole" / spec.name, spec, progress)
            (Path(draft) / "whole").rename(folder.parent)
    except OSError as error:
        if folder.is_dir():  # another process was first
            return folder
        raise CaptureError(
            f"expected to write a rendered capture to {cache}, found: {error.strerror}; name a"
            " writable folder with XDG_CACHE_HOME"
        ) from error
    return folder


def write_capture(folder: Path, spec: CaptureSpec, progress: Progress = silent) -> None:
    """Write rgb/, depth/, their lists, camera.toml, groundtruth.txt and photos/ into a folder.

    The layout is that of the TUM RGB-D benchmark; poses are of the colour camera in a world with
    z up and the floor at z = 0; photos/ holds its own camera.toml and groundtruth.txt, truth/ a
    grid of what really stands in a robot's way, and masks of the walkers if there are any.
    CaptureError where the specification's scene, motion or thing is none that there is.
    """
    _expect_known("scene", spec.scene, SCENES)
    _expect_known("motion", spec.motion, ("", *MOTIONS))
    _expect_known("thing", spec.thing, ("", *THINGS))
    scene = SCENES[spec.scene](spec.seed)
    people = with_walkers(scene, spec)
    _write_frames(folder, people or scene, spec, progress)
    _write_photos(folder / "photos", scene, spec, progress)
    (folder / "truth").mkdir()
    write_grid(folder / "truth", scene.grid(GRID_M, *OBSTACLES_M))
    if people:
        times_s = np.arange(spec.frames) / spec.rate_hz
        write_masks(folder / "truth", people, spec.camera, camera_poses(scene, spec), times_s)


def _expect_known(what: str, name: str, known: Iterable[str]) -> None:
    """CaptureError where a specification names what there is not."""
    if name not in known:
        raise CaptureError(
            f"expected the {what} of a specification to be one of"
            f" {', '.join(filter(None, known))}, found {name!r}"
        )


def with_walkers(scene: Scene, spec: CaptureSpec) -> Peopled | None:
    """The scene with who and what moves in the capture, if anything does; time 0 is frame 0.

    CaptureError where walkers cannot cover the share of pixels that is asked for.
    """
    found: list[Mover] = []
    if spec.walkers:
        step = STEP_S * spec.rate_hz
        at = np.minimum(np.arange(0, spec.frames - 1 + step, step), spec.frames - 1)
        walk = spec.walkers, spec.walker_share, spec.camera, _poses(scene, spec, at), spec.seed
        found += peopled(scene, *walk).walkers
    if spec.thing:
        found.append(thing_before(spec.thing, np.array(scene.tour[0]), spec.seed))
    return Peopled(scene, tuple(found)) if found else None


def camera_poses(scene: Scene | Peopled, spec: CaptureSpec) -> NDArray[np.float64]:
    """T_world_camera (frames, 4, 4) along the scene's tour, or where it begins."""
    return _poses(scene, spec, np.arange(spec.frames, dtype=float))


def _poses(
    scene: Scene | Peopled, spec: CaptureSpec, at: NDArray[np.float64]
) -> NDArray[np.float64]:
    """T_world_camera (M, 4, 4) at numbers of frames, between frames too."""
    turns_per_frame = 2 * np.pi / (PACE_S * spec.rate_hz)
    at = at + spec.uneven * (1 - np.cos(turns_per_frame * at)) / turns_per_frame
    hand = Hand(spec.height_m, spec.pitch_deg, spec.pan_deg, spec.pan_s * spec.rate_hz)
    tour, rng = np.array(scene.tour), _rng(spec, 0)
    if spec.motion:
        T = stay(spec.motion, tour[0], hand, rng, at / spec.rate_hz)
    else:
        T = walk(tour, spec.frames, hand, rng, at)
    shaken = np.deg2rad(spec.tremor_deg), np.deg2rad(spec.roll_deg)
    return T @ trembling(at / spec.rate_hz, *shaken, _rng(spec, 5))


def photo_poses(scene: Scene, spec: CaptureSpec) -> NDArray[np.float64]:
    """T_world_camera (photos, 4, 4): places off the path that see what was seen from the path."""
    rng = _rng(spec, 1)
    T_path = camera_poses(scene, spec)
    obstacles = scene.grid(GRID_M, *OBSTACLES_M)
    poses: list[NDArray[np.float64]] = []
    while len(poses) < spec.photos:
        near = T_path[int((len(poses) + rng.random()) / spec.photos * spec.frames)]
        position = near[:3, 3] + rng.uniform([-0.5, -0.5, -0.3], [0.5, 0.5, 0.3])
        yaw = np.arctan2(near[1, 2], near[0, 2]) + rng.uniform(-0.5, 0.5)
        pitch, roll = np.deg2rad(rng.uniform([-20, -4], [2, 4]))
        T = look(position, np.asarray(yaw), np.asarray(pitch), np.asarray(roll))
        ring = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        around = position[:2] + PHOTO_CLEARANCE_M * np.stack([np.cos(ring), np.sin(ring)], 1)
        row, column = obstacles.cells_at(around).T
        clear = bool((obstacles.cells[row, column] == FREE).all())
        if clear and np.median(scene.render_depth(spec.photo_camera, T)) > NEAREST_VIEW_M:
            poses.append(T)
    return np.array(poses).reshape(-1, 4, 4)


def _write_frames(
    folder: Path, scene: Scene | Peopled, spec: CaptureSpec, progress: Progress
) -> None:
    T_world_camera = camera_poses(scene, spec)
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    stamps_s = FIRST_STAMP_S + np.arange(spec.frames) / spec.rate_hz
    gain = gains(stamps_s, spec.sensor, _rng(spec, 2))
    color_names = [f"rgb/{stamp:.6f}.jpg" for stamp in stamps_s]
    depth_names = [f"depth/{stamp + DEPTH_LAG_S:.6f}.png" for stamp in stamps_s]

    def write(k: int) -> None:
        rng = _rng(spec, 3, k)
        color, depth_m = exposed_frame(scene, spec, k)
        color = measured_color(color, gain[k], spec.sensor, rng)
        depth_m = measured_depth(depth_m, spec.camera, spec.sensor, rng)
        _write_jpeg(folder / color_names[k], color, spec.sensor)
        _write_png(folder / depth_names[k], depth_m)

    _in_parallel(write, spec.frames, "render frames", progress)
    stamps = [f"{stamp:.6f}" for stamp in stamps_s]
    later = [f"{stamp + DEPTH_LAG_S:.6f}" for stamp in stamps_s]
    _write_table(folder / "rgb.txt", "timestamp filename", stamps, color_names)
    _write_table(folder / "depth.txt", "timestamp filename", later, depth_names)
    _write_truth(folder / "groundtruth.txt", stamps, T_world_camera)
    depth = f"\n[depth]\nunits_per_metre = {UNITS_PER_METRE}\n"
    (folder / "camera.toml").write_text(_camera_text(spec.camera) + depth, "utf-8")


def exposed_frame(
    scene: Scene | Peopled, spec: CaptureSpec, k: int
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Colour and exact depth of a frame, each of when it is exposed."""
    stamp_s = k / spec.rate_hz

    def poses_at(after_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return _poses(scene, spec, k + after_s * spec.rate_hz)

    color = exposed_color(scene, spec.camera, spec.sensor, poses_at, stamp_s)
    (later,) = poses_at(np.array([spec.sensor.depth_delay_s]))
    depth_moment = scene.at(stamp_s + spec.sensor.depth_delay_s)
    return color, depth_moment.render_depth(spec.camera, later)


def _write_photos(folder: Path, scene: Scene, spec: CaptureSpec, progress: Progress) -> None:
    T_world_camera = photo_poses(scene, spec)
    folder.mkdir()
    names = [f"{k:03d}.jpg" for k in range(spec.photos)]

    def write(k: int) -> None:
        rng = _rng(spec, 4, k)
        gain = np.full(3, rng.uniform(0.85, 1.15))
        color = scene.render_color(spec.photo_camera, T_world_camera[k])
        _write_jpeg(folder / names[k], measured_color(color, gain, spec.sensor, rng), spec.sensor)

    _in_parallel(write, spec.photos, "render photos", progress)
    _write_truth(folder / "groundtruth.txt", names, T_world_camera)
    (folder / "camera.toml").write_text(_camera_text(spec.photo_camera), "utf-8")


def _in_parallel(write: Callable[[int], None], count: int, task: str, progress: Progress) -> None:
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        for done, _ in enumerate(pool.map(write, range(count)), 1):
            progress(task, done, count)


def _write_jpeg(path: Path, color: NDArray[np.uint8], sensor: Sensor) -> None:
    bgr = np.ascontiguousarray(color[..., ::-1])
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, sensor.jpeg_quality])
    path.write_bytes(data.tobytes())


def _write_png(path: Path, depth_m: NDArray[np.float32]) -> None:
    _, data = cv2.imencode(".png", np.rint(depth_m * UNITS_PER_METRE).astype(np.uint16))
    path.write_bytes(data.tobytes())


def _write_truth(path: Path, names: list[str], T_world_camera: NDArray[np.float64]) -> None:
    values = np.hstack([T_world_camera[:, :3, 3], se3.quat_xyzw(T_world_camera)])
    poses = [" ".join(f"{value:.9f}" for value in row) for row in values]
    _write_table(path, "timestamp or filename tx ty tz qx qy qz qw, camera to world", names, poses)


def _write_table(path: Path, head: str, *columns: list[str]) -> None:
    lines = [f"# {head}", *(" ".join(row) for row in zip(*columns, strict=True))]
    path.write_text("\n".join(lines) + "\n", "utf-8")


def _camera_text(camera: Intrinsics) -> str:
    names = ("width", "height", "fx", "fy", "cx", "cy")
    return "[color]\n" + "".join(f"{name} = {getattr(camera, name)}\n" for name in names)


def _rng(spec: CaptureSpec, *purpose: int) -> np.random.Generator:
    return np.random.default_rng([spec.seed, *purpose])


def _fingerprint(spec: CaptureSpec) -> str:
    """Of the specification and of this package's source."""
    digest = hashlib.sha256(repr(spec).encode())
    for file in sorted(resources.files(__package__).iterdir(), key=lambda file: file.name):
        if file.name.endswith(".py"):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
