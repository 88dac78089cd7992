"""The public sequences that vnav knows: where they are published, and the camera of each."""

import difflib
import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from importlib import resources

from vnav.errors import DatasetError


@dataclass(frozen=True)
class PublicSequence:
    """One sequence as its authors publish it."""

    name: str
    url: str  # of its .tgz
    config: str  # the preset with its camera
    depth: str  # what is known of its depth scale
    page: str  # where its authors describe it
    bytes: int = 0  # of the archive; 0 where unknown
    sha256: str = ""  # of the archive, as its authors publish it; mostly they do not
    truth: bool = True  # whether a true trajectory is published
    note: str = ""

    @property
    def short_name(self) -> str:
        """The name that papers use: fr1/desk for rgbd_dataset_freiburg1_desk."""
        return re.sub(r"^rgbd_dataset_freiburg(\d)_", r"fr\1/", self.name)


def catalogue(base_url: str | None = None) -> list[PublicSequence]:
    """Every sequence in datasets/catalogue.toml, in its order.

    ``base_url`` is the address of a mirror that has the same folders; else the authors' own.
    """
    text = (resources.files("vnav.datasets") / "catalogue.toml").read_text("utf-8")
    table = tomllib.loads(text)
    base = (base_url or table["source"]["base_url"]).rstrip("/")
    return [
        PublicSequence(
            url=f"{base}/{group['folder']}/{entry['name']}.tgz",
            config=group["config"],
            depth=group["depth"],
            page=table["source"]["page"],
            **entry,
        )
        for group in table["group"]
        for entry in group["sequences"]
    ]


def named(sequences: Iterable[PublicSequence], patterns: Iterable[str]) -> list[PublicSequence]:
    """The sequences that names, short names or patterns like fr1/* stand for, each once.

    DatasetError names what fits none; a pattern stands only for sequences with a true trajectory.
    """
    known = list(sequences)
    chosen: dict[str, PublicSequence] = {}
    for pattern in patterns:
        exact = [s for s in known if pattern in (s.name, s.short_name)]
        fitting = [s for s in known if s.truth and _fits(s, pattern)]
        if not exact and not fitting:
            names = [name for s in known for name in (s.name, s.short_name)]
            near = difflib.get_close_matches(pattern, names, 1)
            hint = f"did you mean '{near[0]}'?" if near else "'vnav datasets list' names them all"
            raise DatasetError(f"expected a public sequence, found no '{pattern}'; {hint}")
        chosen |= {s.name: s for s in exact or fitting}
    return list(chosen.values())


def _fits(sequence: PublicSequence, pattern: str) -> bool:
    return any(fnmatchcase(name, pattern) for name in (sequence.name, sequence.short_name))
