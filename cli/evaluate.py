"""Evaluate many sequences: maps, trajectories, photos, against the truth and beside peers."""

from pathlib import Path

import click

from vnav.cli.options import batch_options, config_options, console_progress, require_one_way
from vnav.cli.say import say


@click.command()
@click.argument("suite_source", metavar="SUITE")
@click.option(
    "--seeds",
    metavar="N",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="How many runs of each sequence; they differ by the seed.",
)
@batch_options
@click.option("--resume", is_flag=True, help="Keep the runs in --out that are what is asked for.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("evaluation"),
    show_default=True,
    help="Folder for results.csv, results.json, report.html and runs/ with the trajectories.",
)
@config_options
def evaluate(
    suite_source: str,
    seeds: int,
    jobs: int | None,
    scheduler: str,
    resume: bool,
    out: Path,
    config_source: str | None,
    settings: tuple[str, ...],
) -> int:
    """Map every sequence of SUITE, score it against its truth, locate its photos.

    SUITE is a file, or the name of a suite that ships with vnav; docs/evaluating.md describes it.
    Every run is a row of the table, also one that failed, with its reason. --config and --set
    change the settings of all sequences. One run at a time by default, each in a process of its
    own.

    Exit code 0: every run has a result; 1: at least one failed; the others are told all the same.

    \b
    vnav evaluate my_suite.toml
    vnav evaluate tum_fr1 --seeds 5 --out results --resume
    vnav evaluate my_suite.toml --jobs 2 --set features.max_features=1000
    vnav evaluate tum_fr3 --scheduler tcp://10.0.0.1:8786
    """
    from vnav.api.judging import evaluate as run
    from vnav.core.report import Failed
    from vnav.evaluation.result_files import as_text

    require_one_way(jobs, scheduler)
    outcomes = run(
        suite_source,
        out,
        seeds=seeds,
        config=config_source,
        settings=settings,
        resume=resume,
        jobs=jobs or 1,
        scheduler=scheduler,
        progress=console_progress(),
    )
    for line in as_text(outcomes):
        say(line)
    return int(any(isinstance(outcome.result, Failed) for outcome in outcomes))
