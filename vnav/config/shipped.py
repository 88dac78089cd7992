"""Files that ship with vnav: presets of settings, and cameras."""

from functools import cache
from importlib import resources

PACKAGE, SUFFIX = "vnav.configs", ".toml"


def presets() -> tuple[str, ...]:
    """Names of the presets that ship with vnav."""
    return _names()


def preset_cameras() -> tuple[str, ...]:
    """Names of the cameras that ship with vnav."""
    return _names("cameras")


def preset_text(name: str) -> str:
    """What a preset says."""
    return (resources.files(PACKAGE) / f"{name}{SUFFIX}").read_text("utf-8")


@cache
def _names(*folder: str) -> tuple[str, ...]:
    files = (file.name for file in resources.files(PACKAGE).joinpath(*folder).iterdir())
    return tuple(sorted(name.removesuffix(SUFFIX) for name in files if name.endswith(SUFFIX)))
