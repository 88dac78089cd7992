"""Masks of what moves: one protocol, a plain registry."""

from vnav.config import Config
from vnav.config.registries import MASKS, registered
from vnav.masking.view import Mask, PosedView

__all__ = ["Mask", "PosedView", "mask"]


def mask(config: Config) -> Mask:
    """The mask that the configuration names."""
    made: Mask = registered(MASKS, config.masking.method)(config)
    return made
