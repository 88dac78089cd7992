"""What a map was made with, as its stages recorded it."""

from dataclasses import dataclass
from typing import Any

from vnav.config import SETTINGS
from vnav.config.loading import flat
from vnav.io.store.map_folder import STAGES, MapFolder


@dataclass(frozen=True)
class RecordedSettings:
    """``agreed``: values by full name; ``disagreed``: value of each stage; stages not made yet."""

    agreed: dict[str, Any]
    disagreed: dict[str, dict[str, Any]]
    missing: tuple[str, ...]


def recorded_settings(folder: MapFolder) -> RecordedSettings:
    """The settings in every stage.json, stale stages included; none of a stage that is missing.

    Stages disagree where one was made again with other settings than those before it.
    """
    records = {stage: record for stage in STAGES if (record := folder.recorded(stage))}
    said: dict[str, dict[str, Any]] = {}
    for stage, record in records.items():
        for name, value in flat(record["settings"]):
            if name in SETTINGS:
                said.setdefault(name, {})[stage] = value
    in_order = {name: said[name] for name in SETTINGS if name in said}
    values = {name: list(by_stage.values()) for name, by_stage in in_order.items()}
    agreed = {name: each[0] for name, each in values.items() if each.count(each[0]) == len(each)}
    disagreed = {name: by for name, by in in_order.items() if name not in agreed}
    missing = tuple(stage for stage in STAGES if stage not in records)
    return RecordedSettings(agreed, disagreed, missing)
