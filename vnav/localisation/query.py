"""One photo asked of one map."""

from dataclasses import dataclass

import numpy as np

from vnav.config import LocateConfig
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.matches import Matches
from vnav.localisation.photo import Photo
from vnav.localisation.refine import Sightings
from vnav.localisation.view import View

MIN_DEPTH_M = 0.1


@dataclass(frozen=True)
class Query:
    """The photo, the map it is searched in, and how."""

    photo: Photo
    database: LandmarkDatabase
    config: LocateConfig

    @property
    def near_px(self) -> float:
        """How near a feature must lie to a landmark's projection to agree with it."""
        return self.config.ransac_threshold_px * self.photo.pixel

    def sightings(self, matches: Matches, view: View | None = None) -> Sightings:
        """Points and pixels of the matches; their variance from a view on, where there is one.

        It adds the keypoint's noise and the landmark's, as large as it looks from there.
        """
        points = self.database.index.points_world[matches.landmark]
        px = self.photo.features.keypoints_px[matches.feature]
        keypoint_px = np.full(len(px), self.config.pixel_sigma_px * self.photo.pixel)
        if view is None:
            return Sightings(points, px, keypoint_px**2)
        depth = np.maximum(view.project(points)[1], MIN_DEPTH_M)
        landmark_px = view.intrinsics.fx * self.database.index.sigma_m[matches.landmark] / depth
        return Sightings(points, px, keypoint_px**2 + landmark_px**2)

    def unexplained(self, matches: Matches, views: list[View]) -> Matches:
        """The matches that none of the views agrees with."""
        seen, left = self.sightings(matches), np.ones(len(matches), bool)
        for view in views:
            left &= view.squared_errors(seen.points_world, seen.px) >= self.near_px**2
        return matches[left]
