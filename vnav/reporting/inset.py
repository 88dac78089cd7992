"""The map from above, with where a photo may have been taken."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.voxels import Voxels
from vnav.localisation.verdict.uncertainty import Sigmas
from vnav.localisation.verification.verify import VerifiedPose

Image = NDArray[np.uint8]
Color = tuple[int, int, int]

LOW_M, HIGH_M = 0.10, 1.80  # heights between which things are drawn: no floor, no ceiling
GROUND, THING, MARGIN_M = 245, 90, 0.5
ARROW_M, ELLIPSE_SIGMAS = 0.6, 3.0
GREEN, RED = (40, 160, 40), (60, 60, 230)  # BGR: the pose that is given, those that may be


class Inset:
    """An empty map from above, as high as the photo it goes beside."""

    def __init__(self, voxels: Voxels, height_px: int) -> None:
        heights = voxels.origin[2] + voxels.edge_m * (np.arange(voxels.solid.shape[2]) + 0.5)
        things = voxels.solid[:, :, (heights > LOW_M) & (heights < HIGH_M)].any(2)
        margin = round(MARGIN_M / voxels.edge_m)
        cells = np.pad(things, margin).T[::-1]  # y upwards
        self._scale = height_px / len(cells) / voxels.edge_m  # pixels per metre
        self._corner = voxels.origin[:2] - margin * voxels.edge_m
        grey = np.where(cells, THING, GROUND).astype(np.uint8)
        size = max(1, round(height_px * cells.shape[1] / len(cells))), height_px
        grey = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)
        self.image: Image = np.repeat(grey[:, :, None], 3, 2)

    def draw(self, hypothesis: VerifiedPose, color: Color) -> None:
        """A dot where the camera stands, and an arrow the way it looks."""
        T = hypothesis.view.T_world_camera
        start, tip = self._px(T[:2, 3]), self._px(T[:2, 3] + ARROW_M * T[:2, 2])
        cv2.arrowedLine(self.image, start, tip, color, 2, cv2.LINE_AA, tipLength=0.3)
        cv2.circle(self.image, start, 3, color, -1, cv2.LINE_AA)

    def draw_uncertainty(self, hypothesis: VerifiedPose, sigmas: Sigmas) -> None:
        """The ellipse, to scale, that holds the camera's place on the floor with 99 %."""
        values, vectors = np.linalg.eigh(sigmas.position_covariance[:2, :2])
        lengths = ELLIPSE_SIGMAS * self._scale * np.sqrt(np.maximum(values, 0))
        angle_deg = -np.rad2deg(np.arctan2(vectors[1, 1], vectors[0, 1]))
        centre = self._px(hypothesis.view.centre_world[:2])
        axes = max(1, round(lengths[1])), max(1, round(lengths[0]))
        cv2.ellipse(self.image, centre, axes, angle_deg, 0, 360, GREEN, 1, cv2.LINE_AA)

    def _px(self, xy_world: NDArray[np.float64]) -> tuple[int, int]:
        x, y = self._scale * (xy_world - self._corner)
        return round(x), round(self.image.shape[0] - y)
