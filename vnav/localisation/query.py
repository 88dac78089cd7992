"""One photo asked of one map."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from vnav.config import LocateConfig
from vnav.core.arrays import Rows
from vnav.core.tree import VocabularyTree
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.matches import Correspondences2D3D, Matches
from vnav.localisation.photo import Photo
from vnav.localisation.pixels import Pixels
from vnav.localisation.view import View

MIN_MATCHES = 5  # that a pose can be tried with
RIVAL_SHARE = 0.2  # of the most matches that agree; a place with fewer is no rival
NEAREST_LANDMARK_M = 0.1  # depth from which on a landmark's noise is projected


class SupportedPose(Protocol):
    """A view, and how many matches agree with it."""

    @property
    def view(self) -> View:
        """Where the camera stands."""

    @property
    def inliers(self) -> int:
        """Number of matches that agree."""


@dataclass(frozen=True)
class Query:
    """The photo, the map it is searched in, and how; ``pixels`` of both where they are at hand."""

    photo: Photo
    database: LandmarkDatabase
    config: LocateConfig
    pixels: Pixels | None = None

    @property
    def all_features(self) -> Rows:
        """The rows of all features of the photo."""
        return np.arange(len(self.photo.features))

    @property
    def inlier_threshold_px(self) -> float:
        """How near a feature must lie to a landmark's projection to agree with it."""
        return self.config.ransac_threshold_px * self.photo.pixel_scale

    @property
    def level_2d_3d(self) -> int:
        """Level of the tree, from the root, whose words are searched from photo to map."""
        return existing_level(self.config.level_2d_3d, self.config, self.database.tree)

    @property
    def level_3d_2d(self) -> int:
        """Level of the tree, from the root, whose words are searched from map to photo."""
        return existing_level(self.config.level_3d_2d, self.config, self.database.tree)

    def correspondences(self, matches: Matches, view: View | None = None) -> Correspondences2D3D:
        """Points and pixels of the matches; their variance from a view on, where there is one.

        It adds the keypoint's noise and the landmark's, as large as it looks from there.
        """
        points = self.database.index.points_world[matches.landmark]
        px = self.photo.features.keypoints_px[matches.feature]
        keypoint_px = np.full(len(px), self.config.pixel_sigma_px * self.photo.pixel_scale)
        if view is None:
            return Correspondences2D3D(points, px, keypoint_px**2)
        depth = np.maximum(view.project(points)[1], NEAREST_LANDMARK_M)
        landmark_px = view.intrinsics.fx * self.database.index.sigma_m[matches.landmark] / depth
        return Correspondences2D3D(points, px, keypoint_px**2 + landmark_px**2)

    def unexplained(self, matches: Matches, poses: Sequence[SupportedPose]) -> Matches:
        """The matches that none of the poses agrees with."""
        points, left = self.correspondences(matches), np.ones(len(matches), bool)
        for pose in poses:
            errors = pose.view.squared_errors(points.points_world, points.px)
            left &= errors >= self.inlier_threshold_px**2
        return matches[left]


def existing_level(level: int, config: LocateConfig, tree: VocabularyTree) -> int:
    """A level of the settings as counted from the root, or the nearest that the tree has."""
    return tree.clamped(tree.from_root(level, config.levels_from))


def missing_levels(config: LocateConfig, tree: VocabularyTree) -> tuple[str, ...]:
    """A sentence for each level of the settings that the tree does not have."""
    said = []
    for name in ("level_2d_3d", "level_3d_2d"):
        level = getattr(config, name)
        nearest = existing_level(level, config, tree)
        if tree.from_root(level, config.levels_from) != nearest:
            taken = nearest if config.levels_from == "root" else tree.levels - nearest
            said.append(
                f"expected locate.{name} to be a level of the map's vocabulary tree, 0 to"
                f" {tree.levels} from the {config.levels_from}, found {level}: level {taken} is"
                " searched"
            )
    return tuple(said)


def min_matches(poses: Sequence[SupportedPose]) -> int:
    """Matches that one more place must have: enough for a pose, and a share of the best pose's."""
    most = max((pose.inliers for pose in poses), default=0)
    return max(MIN_MATCHES, int(RIVAL_SHARE * most))
