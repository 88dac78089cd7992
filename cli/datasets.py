"""Fetch public RGB-D sequences."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from vnav.cli.options import console_progress
from vnav.cli.say import say

if TYPE_CHECKING:
    from vnav.io.datasets.fetched import Verdict

json_option = click.option("--json", "as_json", is_flag=True, help="Print it as one JSON array.")
names_argument = click.argument("names", metavar="[NAME]...", nargs=-1)
in_option = click.option(
    "--in",
    "root",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Look there instead of in $VNAV_DATASETS or the user's cache.",
)


@click.group()
def datasets() -> None:
    """List, fetch and verify public RGB-D sequences, as the suites of vnav evaluate use them.

    They are kept in $VNAV_DATASETS, else in vnav/datasets in the user's cache.

    \b
    vnav datasets list 'fr1/*'
    vnav datasets fetch fr1/desk
    vnav datasets verify fr1/desk
    """


@datasets.command("list")
@names_argument
@in_option
@json_option
def list_(names: tuple[str, ...], root: Path | None, as_json: bool) -> None:
    """List the sequences that can be fetched: all, or those NAMEs or patterns stand for."""
    from vnav.io.datasets.catalogue import catalogue, named
    from vnav.io.datasets.fetched import datasets_folder, state

    root = root or datasets_folder()
    chosen = named(catalogue(), names) if names else catalogue()
    states = [state(sequence, root) for sequence in chosen]
    if as_json:
        rows = [
            asdict(sequence) | {"state": found, "folder": str(root / sequence.name)}
            for sequence, found in zip(chosen, states, strict=True)
        ]
        click.echo(json.dumps(rows, indent=1))
        return
    group = ""
    for sequence, found in zip(chosen, states, strict=True):
        heading = f"{sequence.page}  --config {sequence.config}; depth: {sequence.depth}"
        if heading != group:
            click.echo(heading)
            group = heading
        size = f"{sequence.bytes / 1e6:.0f} MB" if sequence.bytes else ""
        notes = [] if sequence.truth else ["no true trajectory"]
        notes += [sequence.note] if sequence.note else []
        line = f"  {sequence.name:62} {found:8} {size:>8}  {'; '.join(notes)}"
        say(line.rstrip())
    click.echo(f"kept in {root}")


@datasets.command()
@click.argument("names", metavar="NAME...", nargs=-1, required=True)
@click.option(
    "--to",
    "root",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Keep them there instead of in $VNAV_DATASETS or the user's cache.",
)
@click.option(
    "--from", "base_url", metavar="URL", help="A mirror with the folders of the original."
)
def fetch(names: tuple[str, ...], root: Path | None, base_url: str | None) -> None:
    """Fetch the sequences NAME: rgbd_dataset_freiburg1_desk, fr1/desk, or a pattern, 'fr1/*'.

    Goes on where an earlier fetch broke off; checks the archive; unpacks it.
    """
    from vnav.io.datasets.catalogue import catalogue, named
    from vnav.io.datasets.fetched import datasets_folder
    from vnav.io.datasets.fetched import fetch as fetch_one

    root = root or datasets_folder()
    for sequence in named(catalogue(base_url), names):
        new = fetch_one(sequence, root, console_progress())
        say(f"{root / sequence.name}  {'fetched' if new else 'there already, and whole'}")


@datasets.command()
@names_argument
@in_option
@json_option
def verify(names: tuple[str, ...], root: Path | None, as_json: bool) -> int:
    """Check every file of the fetched sequences, or of those NAMEs or patterns stand for.

    Exit code 1 where a file is missing or damaged: fetch replaces the sequence then.
    """
    verdicts, absent = _checked(names, root)
    if as_json:
        rows = [{"name": name} | asdict(verdict) for name, verdict in verdicts.items()]
        click.echo(json.dumps(rows + [{"name": name, "files": 0} for name in absent], indent=1))
    else:
        lines = [f"{name}  {_summary(verdict)}" for name, verdict in verdicts.items()]
        lines += [f"{name}  not fetched" for name in absent]
        say("\n".join(lines or ["nothing was fetched yet; 'vnav datasets fetch NAME' does"]))
    return int(bool(absent) or not all(verdict.whole for verdict in verdicts.values()))


def _checked(names: tuple[str, ...], root: Path | None) -> tuple[dict[str, "Verdict"], list[str]]:
    """What was found of each sequence that is there; those asked for by name that are not."""
    from vnav.io.datasets.catalogue import catalogue, named
    from vnav.io.datasets.fetched import datasets_folder, state
    from vnav.io.datasets.fetched import verify as check

    root = root or datasets_folder()
    chosen = named(catalogue(), names) if names else catalogue()
    there = [sequence for sequence in chosen if state(sequence, root) == "fetched"]
    absent = [sequence.name for sequence in chosen if names and sequence not in there]
    return {sequence.name: check(sequence, root) for sequence in there}, absent


def _summary(verdict: "Verdict") -> str:
    wrong = [
        f"{len(names)} {kind} ({', '.join(names[:3])}{', ...' if len(names) > 3 else ''})"
        for names, kind in ((verdict.missing, "missing"), (verdict.damaged, "damaged"))
        if names
    ]
    if not wrong:
        return f"{verdict.files} files, whole"
    return f"{'; '.join(wrong)} of {verdict.files} files"
