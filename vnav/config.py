"""Every setting and its default, once; presets and files hold only differences."""

import dataclasses
import difflib
import tomllib
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from vnav.errors import ConfigError

ConfigT = TypeVar("ConfigT")


@dataclass(frozen=True)
class CaptureConfig:
    """Reading a capture."""

    association_s: float = 0.02  # largest time between a colour image and its depth
    preset_camera: str = ""  # a camera preset to use where the capture has no camera.toml
    units_per_metre: float = 0.0  # of stored depth; above 0 it replaces the camera's
    frame_rate_hz: float = 30.0  # of formats that number their frames and keep no times


@dataclass(frozen=True)
class FeaturesConfig:
    """Keypoints and descriptors."""

    front_end: str = "sift"
    max_features: int = 1500
    contrast_threshold: float = 0.015
    few_features: int = 400  # where fewer are found, they are sought once more
    weak_contrast_threshold: float = 0.006  # with this: bare walls have weak features, which hold
    edge_threshold: float = 10.0
    root_sift: bool = True


@dataclass(frozen=True)
class RegistrationConfig:
    """Two frames to a relative pose."""

    ratio: float = 0.8  # nearest / second-nearest descriptor distance
    mutual: bool = True
    max_distance: float = 0.8  # of unit descriptors: farther ones are no match near a prediction
    search_radius_px: float = 40.0  # about where the last motion, gone on with, puts a feature
    search_features: int = 400  # the strongest, which are sought there: enough to find the motion
    sure_inlier_share: float = 0.85  # of those: with fewer, matches are sought everywhere too
    polish_radius_px: float = 8.0  # about where the motion found puts it
    pixel_sigma_px: float = 1.0
    depth_sigma_per_m2: float = 0.0014  # axial depth noise: sigma = this * z^2 (Khoshelham 2012)
    depth_window_px: int = 9  # window of the plane fit that gives a keypoint its depth
    edge_window_px: int = 5  # the same where the other holds a depth edge
    depth_of_either: bool = True  # a match counts that has depth in the later frame only
    ransac_threshold_px: float = 4.0
    ransac_iterations: int = 200
    min_inliers: int = 15
    min_inlier_share: float = 0.15


@dataclass(frozen=True)
class OdometryConfig:
    """Frame-to-frame odometry and the choice of keyframes."""

    max_depth_m: float = 8.0  # farther depth is not used for features
    keyframe_translation_m: float = 0.25
    keyframe_rotation_deg: float = 15.0
    keyframe_shared: float = 0.5  # new keyframe below this share of the predecessor's inliers
    recent_keyframes: int = 10  # tried, newest first, when predecessor and last keyframe fail
    similar_keyframes: int = 5  # tried by appearance after those
    max_degenerate_frames: int = 30  # in a row, that all pixels hold, but not in every direction


@dataclass(frozen=True)
class VocabularyConfig:
    """The vocabulary tree."""

    branching: int = 10
    max_levels: int = 5
    max_descriptors: int = 500_000  # a word of a large map holds as few landmarks as one of a small
    min_leaf: int = 50  # a node with fewer is not split: smaller ones cost most of the time


@dataclass(frozen=True)
class LoopsConfig:
    """Loop candidates and their verification."""

    candidates: int = 5  # by appearance, per keyframe
    min_relative_score: float = 0.3  # of the similarity between neighbouring keyframes
    exclude_s: float = 5.0  # keyframes nearer in time are no loop
    min_inliers: int = 25
    min_inlier_share: float = 0.25
    sigma_deg: float = 0.3  # added to the noise of the matches: what an imperfect calibration
    sigma_m: float = 0.015  # and a rolling shutter do to two views from afar
    proximity_rounds: int = 2
    proximity_overlap: float = 0.3  # share of the view that both must see
    proximity_candidates: int = 8  # per keyframe and round


@dataclass(frozen=True)
class OptimiseConfig:
    """Pose graph, landmarks, bundle adjustment."""

    max_closure_sigmas: float = 4.0  # a closure farther off after the optimisation is wrong
    bundle_rounds: int = 2  # each ends with the removal of outlying observations
    bundle_iterations: int = 10  # per round
    weak_landmarks: int = 30  # joined keyframes that share fewer are also held by the pose graph
    given_poses: str = "fixed"  # or prior: adjusted within the noise that loops show them to have


@dataclass(frozen=True)
class FuseConfig:
    """Cloud, octree, mesh and grid."""

    max_range_m: float = 4.0  # depth farther away is too noisy, and too flat on table tops
    edge_per_m: float = 0.015  # inverse depth that bends more from pixel to pixel is an edge
    voxel_m: float = 0.02  # of the cloud
    octree_m: float = 0.05
    mesh_voxel_m: float = 0.03
    obstacle_min_m: float = 0.10
    robot_height_m: float = 1.40
    free_height_m: float = 0.15


@dataclass(frozen=True)
class IndexConfig:
    """What finding a photo needs, made ready."""

    min_shared_landmarks: int = 10  # keyframes with so many landmarks in common are covisible
    neighbours: int = 100  # nearest landmarks in space that a match leads to


@dataclass(frozen=True)
class LocateConfig:
    """Active search and the pose of a photo."""

    max_size_px: int = 1600  # the longer side of a photo; larger ones are scaled down
    max_features: int = 3000
    min_features: int = 30
    level_2d_3d: int = 5  # counted from the root = 0, clamped to the tree
    level_3d_2d: int = 2
    ratio_2d_3d: float = 0.75
    ratio_3d_2d: float = 0.75
    enough_matches: int = 100  # in one place; ends the search there
    max_clusters: int = 8  # covisibility clusters that are searched on
    solver: str = "auto"  # p3p where the camera is known, else dlt; or one of the two always
    pixel_sigma_px: float = 1.0  # of a keypoint; pixels are those of an image 640 wide
    ransac_threshold_px: float = 6.0
    ransac_iterations: int = 1000
    min_inliers: int = 12
    min_confidence: float = 0.95  # probability that the pose is right, below which none is given


@dataclass(frozen=True)
class PlanConfig:
    """The path and the robot that follows it."""

    robot_radius_m: float = 0.20
    tolerance_m: float = 0.50  # how far start and goal may be moved to where the robot can be
    clearance_weight: float = 1.0  # a metre where the robot just fits costs 1 + this
    clearance_range_m: float = 0.30  # of clearance beyond that; more is worth nothing
    max_uncertainty_m: float = 0.05  # of the map, in inflation: beyond it doors would close
    spacing_m: float = 0.05  # between points of the path
    allow_unknown: bool = False
    unknown_cost: float = 3.0  # a metre of unknown space costs this times a free one


@dataclass(frozen=True)
class Config:
    """All settings of a run."""

    seed: int = 0
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    features: FeaturesConfig = field(default_factory=FeaturesConfig)
    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    vocabulary: VocabularyConfig = field(default_factory=VocabularyConfig)
    loops: LoopsConfig = field(default_factory=LoopsConfig)
    optimise: OptimiseConfig = field(default_factory=OptimiseConfig)
    fuse: FuseConfig = field(default_factory=FuseConfig)
    index: IndexConfig = field(default_factory=IndexConfig)
    locate: LocateConfig = field(default_factory=LocateConfig)
    plan: PlanConfig = field(default_factory=PlanConfig)


def load(
    source: str | None = None, settings: Iterable[str] = (), base: Config | None = None
) -> Config:
    """A configuration changed by a preset or file, then by ``odometry.max_depth_m=4`` and such.

    It begins with ``base``, else with the defaults. Raises ConfigError for an unknown name, a value
    of the wrong type, or an unreadable file.
    """
    config = base or Config()
    if source is not None:
        config = updated(config, _read(source), source)
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise ConfigError(f"expected --set section.name=value, found '{setting}'")
        change: Any = _parse(text)
        for part in reversed(name.strip().split(".")):
            change = {part: change}
        config = updated(config, change, f"--set {setting}")
    return config


def presets() -> list[str]:
    """Names of the presets that ship with vnav."""
    files = resources.files("vnav.configs").iterdir()
    return sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml"))


def updated(config: ConfigT, changes: Mapping[str, Any], where: str) -> ConfigT:
    """The same frozen dataclass with nested changes; ConfigError names what does not fit."""
    types = typing.get_type_hints(type(config))
    values = {}
    for name, value in changes.items():
        if name not in types:
            near = difflib.get_close_matches(name, types, 1)
            hint = f"did you mean '{near[0]}'?" if near else f"known are: {', '.join(types)}"
            raise ConfigError(f"unknown setting '{name}' in {where}; {hint}")
        values[name] = _fitting(getattr(config, name), value, f"{name} in {where}")
    return dataclasses.replace(config, **values)  # type: ignore[type-var]


def _fitting(old: Any, value: Any, where: str) -> Any:
    if dataclasses.is_dataclass(old) and not isinstance(old, type):
        if not isinstance(value, Mapping):
            raise ConfigError(f"expected a table for {where}, found {value!r}")
        return updated(old, value, where)
    if isinstance(old, float) and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not type(old):
        raise ConfigError(f"expected {type(old).__name__} for {where}, found {value!r}")
    return value


def _read(source: str) -> dict[str, Any]:
    path = Path(source)
    text = resources.files("vnav.configs") / f"{source}.toml"
    try:
        if path.is_file():
            return tomllib.loads(path.read_text("utf-8"))
        if source in presets():
            return tomllib.loads(text.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"expected TOML in {source}, found: {error}") from error
    known = ", ".join(presets())
    raise ConfigError(f"expected a preset ({known}) or a TOML file, found neither: '{source}'")


def _parse(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()
