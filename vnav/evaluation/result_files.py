"""The runs of an evaluation as text for people, as CSV and as JSON."""

import csv
import io
from collections.abc import Iterable, Sequence

from vnav import __version__
from vnav.core.report import Failed
from vnav.evaluation.stored_runs import Outcome
from vnav.evaluation.table import QUERIES, Row, Summary, limits, row, summaries, within
from vnav.io.datasets.suite_file import Suite
from vnav.io.store.map_folder import to_json

OF_RUN = ("sequence", "seed", "state", "reason")  # first columns


def as_csv(outcomes: Iterable[Outcome]) -> str:
    """A header and a line for each run; empty fields for what is not known."""
    rows = [row(outcome) for outcome in outcomes]
    columns = list(dict.fromkeys([*OF_RUN, *(key for each in rows for key in each)]))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def as_json(suite: Suite, outcomes: Sequence[Outcome]) -> str:
    """One object: the suite, each run with all its values, each sequence over its seeds."""
    return to_json(
        {
            "suite": suite.name,
            "description": suite.description,
            "vnav": __version__,
            "runs": [_values(outcome) for outcome in outcomes],
            "sequences": [_plain(summary) for summary in summaries(outcomes)],
        }
    )


def as_text(outcomes: Sequence[Outcome]) -> list[str]:
    """Lines for a person: trajectories, then photos where there are any."""
    rows = [row(outcome) for outcome in outcomes]
    width = max(len("sequence"), *(len(each["sequence"]) for each in rows)) + 2
    lines = [
        f"{'sequence':{width}}{'seed':>4}{'posed':>12}{'ATE m':>9}{'RPE m/s':>9}{'deg/s':>7}"
        f"{'loops':>10}{'wall ms':>9}{'CPU ms':>8}{'MB':>6}"
    ]
    lines += [f"{each['sequence']:{width}}{each['seed']:>4}{_line(each)}" for each in rows]
    for each in summaries(outcomes):
        if each.spread_m is not None:
            lines.append(
                f"{each.name:{width}}median ATE {each.median_m:.4f} m of {len(each.ates_m)} runs,"
                f" {each.ates_m[0]:.4f} to {each.ates_m[-1]:.4f}"
            )
    photos = [
        f"{each['sequence']:{width}}{each['seed']:>4}  {_photos(each, name, column)}"
        for each in rows
        for name, column in QUERIES.items()
        if column in each
    ]
    return [*lines, "", *photos] if photos else lines


def _line(each: Row) -> str:
    if each["state"] == "failed":
        return f"  failed: {each['reason']}"
    numbers = (("ate_rmse_m", 9, 4), ("rpe_1s_m", 9, 4), ("rpe_1s_deg", 7, 3))
    text = f"{each['posed']:>6} / {each['frames']:<3}"
    text += "".join(
        f"{'-':>{width}}" if each[key] is None else f"{each[key]:{width}.{digits}f}"
        for key, width, digits in numbers
    )
    loops = f"{each['loops_accepted']}/{each['loops_tried']}"
    return (
        f"{text}{loops:>10}{each['wall_ms']:9.1f}{each['cpu_ms']:8.1f}{each['peak_memory_mb']:6.0f}"
    )


def _photos(each: Row, name: str, column: str) -> str:
    shares = zip(within(each, column), limits(), strict=True)
    near = ", ".join(f"{share} within {limit}" for share, limit in shares)
    middle = ""
    if each[f"{column}_located"]:
        cm, deg = 100 * each[f"{column}_median_m"], each[f"{column}_median_deg"]
        middle = f" (median {cm:.1f} cm, {deg:.2f} deg)"
    return (
        f"{each[f'{column}_located']} of {each[column]} {name} located{middle}: {near};"
        f" {each[f'{column}_wrong']} wrong"
    )


def _values(outcome: Outcome) -> Row:
    result = outcome.result
    failed = isinstance(result, Failed)
    values = {"reason": result.reason} if isinstance(result, Failed) else result.values
    state = "failed" if failed else "ok"
    task = outcome.task
    return {"sequence": task.entry.name, "seed": task.config.seed, "state": state} | values


def _plain(summary: Summary) -> Row:
    return {
        "name": summary.name,
        "runs": summary.runs,
        "failed": summary.failed,
        "ate_rmse_m": summary.ates_m,
        "median_ate_rmse_m": summary.median_m,
        "peers": [vars(peer) | {"ate_m": peer.ate_m or None} for peer in summary.peers],
    }
