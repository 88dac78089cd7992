"""The runs of an evaluation as one self-contained page, peers' published figures beside ours."""

from collections.abc import Iterator, Sequence
from html import escape
from itertools import groupby
from typing import Any

from vnav import __version__
from vnav.core.report import Failed
from vnav.evaluation.sequence import SequenceRun
from vnav.evaluation.stored_runs import Outcome
from vnav.evaluation.table import QUERIES, Row, limits, row, summaries, within
from vnav.io.datasets.suite_file import Suite
from vnav.io.store.map_folder import STAGES, to_json
from vnav.reporting import html, run_peers
from vnav.reporting.run_pictures import pictures


def page(suite: Suite, outcomes: Sequence[Outcome]) -> str:
    """The page as HTML; nothing is loaded from elsewhere."""
    rows = [row(outcome) for outcome in outcomes]
    title = f"Evaluation: {suite.name}"
    parts = [
        f"<h1>{escape(title)}</h1>\n<small>{escape(suite.description)}</small>",
        _tiles(rows),
        _trajectories(rows),
        run_peers.table(summaries(outcomes)),
        _photos(rows),
        _times(rows),
        *(
            _sequence(name, list(group))
            for name, group in groupby(outcomes, key=lambda outcome: outcome.task.entry.name)
        ),
    ]
    return html.document(title, "\n".join(parts))


def _succeeded(rows: Sequence[Row]) -> list[Row]:
    return [each for each in rows if each["state"] == "ok"]


def _tiles(rows: Sequence[Row]) -> str:
    good = _succeeded(rows)
    posed, frames = (sum(each[key] for each in good) for key in ("posed", "frames"))
    tiles = {
        "sequences": len({each["sequence"] for each in rows}),
        "runs": len(rows),
        "failed": len(rows) - len(good),
        "frames posed": f"{posed} of {frames}",
        "vnav": __version__,
    }
    return html.tiles(tiles)


def _trajectories(rows: Sequence[Row]) -> str:
    head = ("sequence", "seed", "posed", "ATE m", "median", "max", "RPE m", "deg", "loops", "lost")
    return (
        "<h2>Trajectories</h2>\n"
        + html.table(head, map(_trajectory, rows))
        + "<p>ATE: RMSE, median and largest error of positions after SE(3) alignment, of the frames"
        " that have a pose. RPE: RMSE over 1 s. Both by the definitions of the TUM benchmark."
        " Loops: accepted of those tried. Lost: frames without a pose.</p>"
    )


def _trajectory(each: Row) -> tuple[Any, ...]:
    if each["state"] == "failed":
        return *_named(each), f'<span class="rejected">failed</span>: {escape(each["reason"])}'
    numbers = {"ate_rmse_m": 4, "ate_median_m": 4, "ate_max_m": 4, "rpe_1s_m": 4, "rpe_1s_deg": 3}
    return (
        *_named(each),
        f"{each['posed']} of {each['frames']}",
        *(_number(each[key], digits) for key, digits in numbers.items()),
        f"{each['loops_accepted']} of {each['loops_tried']}",
        escape(each["lost"]),
    )


def _photos(rows: Sequence[Row]) -> str:
    head = ("sequence", "seed", "", "located", "median", *limits(), "wrong", "refused")
    cells = [
        (*_named(each), name, *_located(each, column))
        for each in _succeeded(rows)
        for name, column in QUERIES.items()
        if column in each
    ]
    if not cells:
        return ""
    return (
        "<h2>Photos</h2>\n"
        + html.table(head, cells)
        + "<p>Shares are of all photos, medians of those located. Wrong: located, and off by more"
        " than 30 cm or 10 deg.</p>"
    )


def _located(each: Row, column: str) -> Iterator[str]:
    yield f"{each[f'{column}_located']} of {each[column]}"
    cm, deg = each[f"{column}_median_m"], each[f"{column}_median_deg"]
    yield "-" if cm is None else f"{100 * cm:.1f} cm, {deg:.2f} deg"
    yield from within(each, column)
    yield str(each[f"{column}_wrong"])
    yield str(each[f"{column}_refused"])


def _times(rows: Sequence[Row]) -> str:
    good = _succeeded(rows)
    if not good:
        return ""
    keys = ("", *(f"_{stage}" for stage in STAGES))
    cells = [
        (
            *_named(each),
            *(_clocks(each, key) for key in keys),
            f"{each['peak_memory_mb']:.0f} MB",
            f"{escape(each['host'])}, {each['cores']} cores",
        )
        for each in good
    ]
    return (
        "<h2>Time and memory</h2>\n"
        + html.table(("sequence", "seed", "all", *STAGES, "memory", "machine"), cells)
        + "<p>Milliseconds a frame, wall / CPU of all cores. Runs that share a machine slow each"
        " other down: for times, run one at once.</p>"
    )


def _sequence(name: str, outcomes: Sequence[Outcome]) -> str:
    runs = {
        outcome.task.config.seed: outcome.result
        for outcome in outcomes
        if not isinstance(outcome.result, Failed)
    }
    parts = [f"<h2>{escape(name)}</h2>"]
    if runs:
        drawn = pictures(runs)
        shown = [html.picture(f"{title} of {name}", png) for title, png in drawn.items()]
        parts += [html.beside(*shown[:2]), *shown[2:]]
    for seed, run in runs.items():
        parts += [_lost(seed, run), _loops(seed, run)]
        parts.append(html.details(f"All numbers of seed {seed}", to_json(run.values)))
    for outcome in outcomes:
        if isinstance(outcome.result, Failed):
            text = f"{outcome.result.reason}\n{outcome.result.traceback}"
            parts.append(html.details(f"Why seed {outcome.task.config.seed} failed", text))
    return "\n".join(parts)


def _lost(seed: int, run: SequenceRun) -> str:
    spans = [(f"{s['first']} to {s['last']}", escape(s["reason"])) for s in run.values["lost"]]
    table = html.table((f"frames without a pose, seed {seed}", "reason"), spans)
    return table if spans else ""


def _loops(seed: int, run: SequenceRun) -> str:
    loops = run.values["loops"]
    counts = [("accepted", loops["accepted"])]
    counts += [(f"rejected: {escape(reason)}", n) for reason, n in loops["reasons"].items()]
    return html.table((f"loops, seed {seed}", "candidates"), counts)


def _named(each: Row) -> tuple[str, Any]:
    return escape(each["sequence"]), each["seed"]


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _clocks(each: Row, stage: str) -> str:
    times = (each[f"{clock}_ms{stage}"] for clock in ("wall", "cpu"))
    return "&nbsp;/&nbsp;".join(f"{ms:.0f}" if ms >= 100 else f"{ms:.1f}" for ms in times)
