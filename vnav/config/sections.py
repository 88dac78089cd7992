"""The settings by section: default, what it may be, unit, meaning. No other place says any of it.

Ranges end where the code could do nothing with a value, or nothing a person could mean.
"""

from dataclasses import dataclass

from vnav.config.registries import (
    ESTIMATORS,
    FILTERS,
    FRONT_ENDS,
    MASKS,
    SEARCHES,
    TRACKERS,
)
from vnav.config.setting import Section, choice, flag, number, outline, section, whole
from vnav.config.shipped import preset_cameras


@dataclass(frozen=True)
class CaptureConfig(Section, path="capture"):
    """Reading a capture."""

    association_s: float = number(
        0.02, "(0, 10]", "s", "largest time between a colour image and its depth image"
    )
    preset_camera: str = choice(
        "",
        lambda: ("", *preset_cameras()),
        "camera that ships with vnav, for a capture that has no camera.toml; empty: none",
    )
    units_per_metre: float = number(
        0.0, "[0, 1000000]", "1/m", "units of stored depth; 0: those of the camera"
    )
    frame_rate_hz: float = number(
        30.0,
        "[0.01, 10000]",
        "Hz",
        "frame rate of a capture whose frames have numbers and no times",
    )
    flatten: str = choice(
        "auto",
        lambda: ("auto", "off"),
        "whether light that surely and strongly falls off from the image centre, as a lamp's on the"
        " camera does, and bands of lamps that flicker are taken off the frames",
    )
    overlay: str = choice(
        "auto",
        lambda: ("auto", "off"),
        "whether depth is left out where all views show the same, as burnt-in text or a part of the"
        " robot",
    )


@dataclass(frozen=True)
class SiftConfig(Section, path="features.sift"):
    """The front-end SIFT."""

    contrast_threshold: float = number(
        0.015, "[0, 1]", "grey level / 255", "features with less contrast are not used"
    )
    few_features: int = whole(
        400,
        "[0, 100000]",
        "features",
        "an image with fewer is searched again with weak_contrast_threshold",
    )
    weak_contrast_threshold: float = number(
        0.006,
        "[0, 1]",
        "grey level / 255",
        "contrast threshold of the second search: bare walls have weak features only",
        rule="<= contrast_threshold",
    )
    edge_threshold: float = number(
        10.0,
        "[1, 1000]",
        "ratio",
        "features with a larger ratio of principal curvatures lie on edges and are not used",
    )
    root_sift: bool = flag(True, "RootSIFT descriptors instead of plain SIFT")
    half_size: bool = flag(True, "frames between keyframes are described at half their size")
    min_half_width_px: int = whole(
        320, "[0, 100000]", "px", "a frame whose half is narrower is described whole"
    )


def corner_threshold() -> int:
    """Declare by how much the pixels on a corner's circle differ from its centre."""
    return whole(
        20, "[1, 255]", "grey levels", "a corner is so much brighter or darker than its circle"
    )


@dataclass(frozen=True)
class OrbConfig(Section, path="features.orb"):
    """The front-end ORB."""

    levels: int = whole(
        4,
        "[1, 16]",
        "levels",
        "levels of the image pyramid; corners of coarser ones are less exact",
    )
    scale_factor: float = number(1.2, "[1.01, 2]", "ratio", "size of a level to that of the next")
    threshold: int = corner_threshold()
    weak_threshold: int = whole(
        7,
        "[1, 255]",
        "grey levels",
        "threshold where a cell of 32 x 32 px has no corner otherwise",
        rule="<= threshold",
    )
    relative_threshold: float = number(
        0.0,
        "[0, 1]",
        "share",
        "in the place of both thresholds, a share of the corner's own brightness; 0: they hold",
    )


@dataclass(frozen=True)
class BriskConfig(Section, path="features.brisk"):
    """The front-end BRISK."""

    threshold: int = corner_threshold()
    octaves: int = whole(3, "[0, 8]", "octaves", "octaves of the scale space")


@dataclass(frozen=True)
class FastConfig(Section, path="features.fast"):
    """The front-end of improved FAST corners."""

    threshold: int = corner_threshold()
    arc: int = whole(
        9, "[9, 12]", "px", "pixels side by side on the circle of 16 that make a corner"
    )
    edge_limit: int = whole(
        10,
        "[0, 16]",
        "px",
        "a corner with more pixels on its circle that look like both neighbours is on an edge;"
        " 16: none is",
    )


@dataclass(frozen=True)
class FeaturesConfig(Section, path="features"):
    """Keypoints and descriptors."""

    front_end: str = choice(
        "sift",
        lambda: tuple(FRONT_ENDS),
        "what finds and describes features",
        absent={"surf": "SURF is patented code, which OpenCV's wheels do not have"},
    )
    max_features: int = whole(
        1500,
        "[1, 100000]",
        "features",
        "largest number of features of a frame; the strongest are kept",
    )
    sift: SiftConfig = section(SiftConfig)
    orb: OrbConfig = section(OrbConfig)
    brisk: BriskConfig = section(BriskConfig)
    fast: FastConfig = section(FastConfig)

    @property
    def half_size(self) -> bool:
        """Whether frames between keyframes are described at half their size."""
        return self.front_end == "sift" and self.sift.half_size


@dataclass(frozen=True)
class RegistrationConfig(Section, path="registration"):
    """Two frames to a relative pose."""

    estimator: str = choice(
        "points3d",
        lambda: tuple(ESTIMATORS),
        "what tells the motion that matches show: 3D points of both frames; pnp: pixels of one;"
        " direct: all pixels",
    )
    ratio: float = number(
        0.8,
        "(0, 1]",
        "ratio",
        "a match has a smaller ratio of nearest to second-nearest descriptor distance",
    )
    mutual: bool = flag(True, "a match is the nearest descriptor seen from either frame")
    rotation_bins: int = whole(
        0,
        "[0, 360]",
        "bins",
        "of the turns from feature to matched feature; matches outside of the three fullest are"
        " left out; 0: all are kept",
    )
    max_distance: float = number(
        0.8,
        "(0, 2]",
        "descriptor length",
        "largest distance of the unit descriptors of a match near a prediction",
    )
    search_radius_px: float = number(
        40.0,
        "(0, 10000]",
        "px",
        "matches are first sought within this distance of where the last motion predicts them",
    )
    search_features: int = whole(
        400,
        "[3, 100000]",
        "features",
        "number of features that are sought near the prediction; the strongest are taken",
    )
    search_min_inlier_share: float = number(
        0.85,
        "[0, 1]",
        "share",
        "with a smaller share of inliers near the prediction, the whole image is searched too",
    )
    refine_radius_px: float = number(
        8.0,
        "(0, 10000]",
        "px",
        "with the motion found, matches are sought again within this distance of its prediction",
        rule="<= search_radius_px",
    )
    pixel_sigma_px: float = number(
        1.0, "[0.01, 100]", "px", "standard deviation of a keypoint's place in the image"
    )
    depth_sigma_per_m2: float = number(
        0.0014,
        "[0.000001, 1]",
        "m/m2",
        "axial depth noise: its standard deviation is this times depth squared (Khoshelham 2012)",
    )
    depth_window_px: int = whole(
        9, "[3, 101]", "px", "window of the plane fit that gives a keypoint its depth", odd=True
    )
    edge_window_px: int = whole(
        5,
        "[3, 101]",
        "px",
        "window that is tried where depth_window_px holds a depth edge",
        odd=True,
        rule="<= depth_window_px",
    )
    one_sided_depth: bool = flag(
        True, "a match counts although only one of its keypoints has depth"
    )
    ransac_threshold_px: float = number(
        4.0, "[0.01, 1000]", "px", "largest reprojection error of an inlier"
    )
    ransac_iterations: int = whole(
        200, "[1, 1000000]", "samples", "largest number of samples of three matches"
    )
    min_inliers: int = whole(15, "[3, 100000]", "matches", "a pose with fewer inliers is rejected")
    min_inlier_share: float = number(
        0.15, "[0, 1]", "share", "a pose with a smaller share of inliers is rejected"
    )


@dataclass(frozen=True)
class EkfConfig(Section, path="tracking.ekf"):
    """The filter over the camera and few features."""

    depth: bool = flag(
        True, "depth gives new features their distance; else the trajectory has no scale"
    )
    sigma_m_s2: float = number(
        4.0, "[0.001, 1000]", "m/s2", "standard deviation of the camera's acceleration"
    )
    sigma_rad_s2: float = number(
        12.0, "[0.001, 1000]", "rad/s2", "standard deviation of its angular acceleration"
    )
    pixel_sigma_px: float = number(
        1.0, "[0.01, 100]", "px", "standard deviation of the place where a feature is found"
    )
    max_features: int = whole(
        60, "[10, 500]", "features", "largest number in the state; time grows with its square"
    )
    corner_threshold: int = whole(
        7, "[1, 255]", "grey levels", "a feature is so much brighter or darker than its circle"
    )
    nearest_m: float = number(
        1.0, "[0.01, 100]", "m", "without depth, new features are expected beyond this distance"
    )
    min_inliers: int = whole(
        5, "[3, 500]", "features", "a frame in which fewer agree on one motion is lost"
    )
    max_lost_s: float = number(
        0.5, "[0, 60]", "s", "after a longer time without a frame the filter begins anew"
    )


@dataclass(frozen=True)
class TrackingConfig(Section, path="tracking"):
    """How a frame is held against the frames before."""

    method: str = choice(
        "descriptors",
        lambda: (*TRACKERS, *FILTERS),
        "what finds the points of a frame in the next; descriptors: every frame is described,"
        " else only keyframes are; ekf: a filter over all frames",
    )
    min_points: int = whole(
        60,
        "[0, 100000]",
        "points",
        "a frame in which fewer points are found, at half its size or again, is described whole",
    )
    ekf: EkfConfig = section(EkfConfig)

    @property
    def has_scale(self) -> bool:
        """Whether lengths are in metres, for depth is used."""
        return self.method not in FILTERS or self.ekf.depth


@dataclass(frozen=True)
class MaskingConfig(Section, path="masking"):
    """What moves, and is left out."""

    method: str = choice(
        "motion",
        lambda: tuple(MASKS),
        "what finds moving things; none: everything is taken to stand still",
    )
    warp: str = choice(
        "depth",
        lambda: ("depth", "homography"),
        "what follows the camera: depth and pose, or a homography, and brightness alone",
    )
    window_s: float = number(
        4.0, "[0.1, 60]", "s", "time before and after a frame whose frames tell what moves in it"
    )
    depth_margin_m: float = number(
        0.07,
        "[0, 10]",
        "m",
        "a surface is seen through where depth is farther by more than this and its noise",
    )
    min_region_px: int = whole(200, "[0, 100000000]", "px", "a smaller region is not masked")
    max_share: float = number(
        0.9, "[0, 1]", "share", "a frame of which a larger share would be masked has no mask"
    )


@dataclass(frozen=True)
class OdometryConfig(Section, path="odometry"):
    """Frame-to-frame odometry and the choice of keyframes."""

    max_depth_m: float = number(8.0, "(0, 100]", "m", "farther depth gives features no 3D point")
    keyframe_translation_m: float = number(
        0.25, "[0, 100]", "m", "a frame farther than this from the last keyframe becomes one"
    )
    keyframe_rotation_deg: float = number(
        15.0, "[0, 180]", "deg", "a frame turned more than this from the last keyframe becomes one"
    )
    keyframe_min_inlier_share: float = number(
        0.5,
        "[0, 1]",
        "share",
        "a frame becomes a keyframe when its inliers with the last one are a smaller share of those"
        " with the frame before",
    )
    recent_keyframes: int = whole(
        10,
        "[0, 1000]",
        "keyframes",
        "number that is tried, newest first, when the frame before and the last keyframe fail",
    )
    similar_keyframes: int = whole(
        5,
        "[0, 1000]",
        "keyframes",
        "number that is tried after those, the most similar in appearance first",
    )
    max_degenerate_frames: int = whole(
        30,
        "[0, 100000]",
        "frames",
        "largest number in a row that their pixels hold, but not in every direction",
    )
    kept_frames: str = choice(
        "keyframes",
        lambda: ("keyframes", "all"),
        "frames whose colour and depth the map keeps, all of which are fused",
    )
    against_map: bool = flag(
        False,
        "frames are also tracked against all keyframes that see the same, by patches of 8 pixels",
    )


@dataclass(frozen=True)
class VocabularyConfig(Section, path="vocabulary"):
    """The vocabulary tree."""

    branching: int = whole(
        10, "[2, 1000]", "children", "number of clusters that a node is split into"
    )
    max_levels: int = whole(5, "[1, 20]", "levels", "depth of the tree below its root")
    max_descriptors: int = whole(
        500_000,
        "[1, 100000000]",
        "descriptors",
        "largest number that the tree is trained on",
    )
    min_leaf: int = whole(50, "[2, 1000000]", "descriptors", "a node with fewer is not split")
    method: str = choice(
        "hierarchical",
        lambda: ("hierarchical", "approximate"),
        "each node split by k-means; or flat words by approximate k-means, whose centres are"
        " clustered again for the coarser levels",
    )
    words: int = whole(
        10_000,
        "[2, 1000000]",
        "words",
        "number of words of the approximate method; fewer where descriptors are few",
    )


@dataclass(frozen=True)
class LoopsConfig(Section, path="loops"):
    """Loop candidates and their verification."""

    candidates: int = whole(
        5, "[0, 1000]", "keyframes", "number of loop candidates by appearance, for each keyframe"
    )
    min_relative_score: float = number(
        0.3,
        "[0, 1]",
        "share",
        "a candidate needs this share of the similarity of neighbouring keyframes",
    )
    exclude_s: float = number(5.0, "[0, 1000000]", "s", "keyframes nearer in time make no loop")
    min_inliers: int = whole(25, "[3, 100000]", "matches", "a loop with fewer inliers is rejected")
    min_inlier_share: float = number(
        0.25, "[0, 1]", "share", "a loop with a smaller share of inliers is rejected"
    )
    sigma_deg: float = number(
        0.3,
        "[0, 90]",
        "deg",
        "added to a loop's noise in rotation, for imperfect calibration and rolling shutter",
    )
    sigma_m: float = number(
        0.015, "[0, 100]", "m", "added to a loop's noise in translation, for the same reason"
    )
    proximity_rounds: int = whole(
        2, "[0, 100]", "rounds", "number of searches for keyframes that see the same by their poses"
    )
    proximity_overlap: float = number(
        0.3, "(0, 1]", "share", "share of the view that two such keyframes must have in common"
    )
    proximity_candidates: int = whole(
        8, "[0, 1000]", "keyframes", "number of such candidates in a round, for each keyframe"
    )


@dataclass(frozen=True)
class OptimiseConfig(Section, path="optimise"):
    """Pose graph, landmarks, bundle adjustment."""

    max_closure_sigmas: float = number(
        4.0,
        "(0, 1000]",
        "standard deviations",
        "a loop closure farther off after the pose graph is optimised is wrong",
    )
    bundle_rounds: int = whole(
        2,
        "[0, 100]",
        "rounds",
        "rounds of bundle adjustment; each ends with the removal of outliers; 0: poses are those of"
        " the pose graph",
    )
    bundle_iterations: int = whole(
        10, "[1, 1000]", "iterations", "largest number of iterations of the last round"
    )
    min_shared_landmarks: int = whole(
        30,
        "[0, 1000000]",
        "landmarks",
        "joined keyframes that share fewer are held by their pose graph edge too",
    )
    max_keyframes: int = whole(
        300,
        "[1, 1000000]",
        "keyframes",
        "of more, bundle adjustment and index do without those all of whose landmarks others see",
    )
    estimate_delays: bool = flag(
        True, "a delay of depth and a rolling shutter are estimated, and allowed for"
    )
    up_in_images: str = choice(
        "auto",
        lambda: ("auto", "top", "bottom", "left", "right", "behind", "ahead"),
        "the side of the images that is up; behind: the camera looks down; auto: as most likely",
    )
    given_poses: str = choice(
        "fixed",
        lambda: ("fixed", "prior"),
        "poses from elsewhere stay as they are, or are adjusted within the noise that loops show",
    )


@dataclass(frozen=True)
class FuseConfig(Section, path="fuse"):
    """Cloud, octree, mesh and grid."""

    max_range_m: float = number(
        4.0,
        "[0.01, 13.1]",
        "m",
        "farther depth is too noisy to be fused; a map stores depth up to 13.1 m",
    )
    edge_per_m: float = number(
        0.015, "(0, 10]", "1/m", "inverse depth that bends more from pixel to pixel is an edge"
    )
    voxel_m: float = number(0.02, "[0.001, 1]", "m", "voxel of the cloud")
    octree_m: float = number(0.05, "[0.001, 1]", "m", "voxel of the octree and cell of the grid")
    mesh_voxel_m: float = number(0.03, "[0.001, 1]", "m", "voxel of the volume behind the mesh")
    departed_after: int = whole(
        3,
        "[0, 1000]",
        "keyframes",
        "so many must see through a place, after the last that saw something there, for that to"
        " have departed; 0: nothing departs",
    )
    floor_m: float = number(
        0.0,
        "[-1000, 1000]",
        "m",
        "height of the floor that the grid is of, where a map has several storeys",
    )
    obstacle_min_m: float = number(
        0.10,
        "[0, 100]",
        "m",
        "height above the floor from which something is an obstacle",
        rule="< robot_height_m",
    )
    robot_height_m: float = number(
        1.40, "(0, 100]", "m", "height above the floor up to which something is an obstacle"
    )
    free_height_m: float = number(
        0.15, "[0, 10]", "m", "free space so near to the floor shows that a cell is free"
    )
    walked_radius_m: float = number(
        0.20,
        "[0, 10]",
        "m",
        "floor that nobody saw is walked so near to the camera's path; 0: none is",
    )


@dataclass(frozen=True)
class IndexConfig(Section, path="index"):
    """What finding a photo needs, made ready."""

    min_shared_landmarks: int = whole(
        10, "[1, 1000000]", "landmarks", "keyframes that share so many are covisible"
    )
    neighbours: int = whole(
        100,
        "[1, 10000]",
        "landmarks",
        "number of landmarks nearest to a match, which are searched next",
    )


@dataclass(frozen=True)
class LocateConfig(Section, path="locate"):
    """Active search and the pose of a photo."""

    max_size_px: int = whole(
        1600, "[64, 100000]", "px", "longer side of a photo; a larger one is scaled down"
    )
    max_features: int = whole(
        3000,
        "[1, 100000]",
        "features",
        "largest number of features of a photo; the strongest are kept",
    )
    min_features: int = whole(30, "[1, 100000]", "features", "a photo with fewer is not located")
    search: str = choice(
        "compound",
        lambda: tuple(SEARCHES),
        "how matches are sought: 2D-3D, then 3D-2D in each cluster; 3D-2D around each 2D-3D match"
        " as it is found; one direction alone; in the leaves of the tree nearest to a feature",
    )
    levels_from: str = choice(
        "root",
        lambda: ("root", "leaves"),
        "where levels are counted from, which is level 0; leaves: the deepest of them",
    )
    level_2d_3d: int = whole(
        -1, "[-1, 20]", "level", "tree level of the search from photo to map; -1: the finest"
    )
    level_3d_2d: int = whole(
        2, "[-1, 20]", "level", "tree level of the search from map to photo; -1: the finest"
    )
    ratio_2d_3d: float = number(
        0.75, "(0, 1]", "ratio", "ratio test of the search from photo to map"
    )
    ratio_3d_2d: float = number(
        0.75, "(0, 1]", "ratio", "ratio test of the search from map to photo"
    )
    enough_matches: int = whole(
        100, "[1, 100000]", "matches", "the search ends when one place has so many"
    )
    max_clusters: int = whole(
        8,
        "[1, 1000]",
        "clusters",
        "largest number of covisibility clusters in which the search goes on",
    )
    solver: str = choice(
        "auto",
        lambda: ("auto", "p3p", "dlt"),
        "solver of the pose; auto: p3p where the focal length is known, else dlt",
    )
    pixel_sigma_px: float = number(
        1.0, "[0.01, 1000]", "px", "standard deviation of a keypoint, in an image 640 px wide"
    )
    ransac_threshold_px: float = number(
        6.0,
        "[0.01, 1000]",
        "px",
        "largest reprojection error of an inlier, in an image 640 px wide",
    )
    ransac_iterations: int = whole(
        1000, "[1, 1000000]", "samples", "largest number of minimal samples"
    )
    min_inliers: int = whole(
        12, "[4, 100000]", "matches", "a photo with fewer in every place is not located"
    )
    min_confidence: float = number(
        0.95,
        "(0, 1)",
        "probability",
        "least probability that the pose is right; with less none is given",
    )
    sequence_step_m: float = number(
        2.0,
        "(0, 1000]",
        "m",
        "how far the camera moves, as a rule, from one photo of a sequence to the next",
    )


@dataclass(frozen=True)
class PlanConfig(Section, path="plan"):
    """The path and the robot that follows it."""

    robot_radius_m: float = number(0.20, "[0, 100]", "m", "radius of the robot, seen from above")
    footprint: str = outline(
        "m",
        "the robot seen from above, in place of its radius: x forward, y left, about the point that"
        " follows the path",
    )
    tolerance_m: float = number(
        0.50,
        "[0, 100]",
        "m",
        "largest distance that start and goal are moved to where the robot can be",
    )
    clearance_weight: float = number(
        1.0, "[0, 1000]", "factor", "a metre where the robot just fits costs 1 + this"
    )
    clearance_range_m: float = number(
        0.30, "[0.001, 100]", "m", "more clearance than this beyond the robot's is worth nothing"
    )
    max_uncertainty_m: float = number(
        0.05,
        "[0, 100]",
        "m",
        "largest uncertainty of the map that obstacles are inflated by; more would close doors",
    )
    smooth: bool = flag(True, "the path is smoothed; else it joins the centres of its cells")
    spacing_m: float = number(
        0.05, "[0.001, 100]", "m", "largest distance between points of the path"
    )
    allow_walked: bool = flag(
        True, "the path may cross floor that was never seen, but where the camera was carried"
    )
    walked_cost: float = number(
        2.0, "[1, 1000]", "factor", "a metre of walked floor costs this times a free one"
    )
    allow_unknown: bool = flag(False, "the path may cross space that was never seen")
    unknown_cost: float = number(
        3.0, "[1, 1000]", "factor", "a metre of unknown space costs this times a free one"
    )


@dataclass(frozen=True)
class Config(Section, path=""):
    """All settings of a run."""

    seed: int = whole(0, "[0, 4294967295]", "number", "where all random numbers of a run begin")
    capture: CaptureConfig = section(CaptureConfig)
    features: FeaturesConfig = section(FeaturesConfig)
    registration: RegistrationConfig = section(RegistrationConfig)
    tracking: TrackingConfig = section(TrackingConfig)
    masking: MaskingConfig = section(MaskingConfig)
    odometry: OdometryConfig = section(OdometryConfig)
    vocabulary: VocabularyConfig = section(VocabularyConfig)
    loops: LoopsConfig = section(LoopsConfig)
    optimise: OptimiseConfig = section(OptimiseConfig)
    fuse: FuseConfig = section(FuseConfig)
    index: IndexConfig = section(IndexConfig)
    locate: LocateConfig = section(LocateConfig)
    plan: PlanConfig = section(PlanConfig)
