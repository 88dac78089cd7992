"""Masks of what moves: one protocol, a plain registry."""

from collections.abc import Callable

from vnav.config import Config
from vnav.masking.motion import MotionMask
from vnav.masking.nothing import NoMask
from vnav.masking.view import Mask, PosedView

__all__ = ["METHODS", "Mask", "PosedView", "mask"]

METHODS: dict[str, Callable[[Config], Mask]] = {"none": NoMask, "motion": MotionMask}


def mask(config: Config) -> Mask:
    """The mask that the configuration names."""
    return METHODS[config.masking.method](config)
