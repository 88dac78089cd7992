"""Every setting once: default, range, unit and meaning; checked when a configuration is made."""

from vnav.config.loading import SETTINGS, load, preset_cameras, presets, updated
from vnav.config.sections import (
    CaptureConfig,
    Config,
    FeaturesConfig,
    FuseConfig,
    IndexConfig,
    LocateConfig,
    LoopsConfig,
    MaskingConfig,
    OdometryConfig,
    OptimiseConfig,
    OrbConfig,
    PlanConfig,
    RegistrationConfig,
    SiftConfig,
    VocabularyConfig,
)

__all__ = [
    "SETTINGS",
    "CaptureConfig",
    "Config",
    "FeaturesConfig",
    "FuseConfig",
    "IndexConfig",
    "LocateConfig",
    "LoopsConfig",
    "MaskingConfig",
    "OdometryConfig",
    "OptimiseConfig",
    "OrbConfig",
    "PlanConfig",
    "RegistrationConfig",
    "SiftConfig",
    "VocabularyConfig",
    "load",
    "preset_cameras",
    "presets",
    "updated",
]
