"""Estimators of the motion that matches show: one protocol, a plain registry."""

from typing import Protocol

import numpy as np

from vnav.config import RegistrationConfig
from vnav.config.registries import ESTIMATORS, registered
from vnav.core.arrays import Array
from vnav.core.frame import PoseEstimate, Rejected
from vnav.registration.correspondences import Correspondences

__all__ = ["Estimator", "estimator"]


class Estimator(Protocol):
    """Finds the motion between two frames, with its information, or why there is none."""

    def estimate(
        self, correspondences: Correspondences, rng: np.random.Generator
    ) -> PoseEstimate | Rejected:
        """``T_a_b`` from matches alone, many of which may be wrong."""

    def refine(self, T_a_b: Array, correspondences: Correspondences) -> PoseEstimate | Rejected:
        """The best motion near a first one."""


def estimator(config: RegistrationConfig) -> Estimator:
    """The estimator that the configuration names."""
    made: Estimator = registered(ESTIMATORS, config.estimator)(config)
    return made
