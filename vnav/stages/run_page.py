"""The runs of an evaluation as one self-contained page, peers' published figures beside ours."""

from collections.abc import Iterator, Sequence
from html import escape
from itertools import groupby
from typing import Any

from vnav import __version__
from vnav.core.report import Failed
from vnav.io.map_folder import STAGES, to_json
from vnav.io.suite_file import Peer, Suite
from vnav.stages import html
from vnav.stages.evaluate import Run
from vnav.stages.run_pictures import pictures
from vnav.stages.run_table import QUERIES, Row, Summary, limits, row, summaries, within
from vnav.stages.runs import Outcome


def page(suite: Suite, outcomes: Sequence[Outcome]) -> str:
    """The page as HTML; nothing is loaded from elsewhere."""
    rows = [row(outcome) for outcome in outcomes]
    title = f"Evaluation: {suite.name}"
    parts = [
        f"<h1>{escape(title)}</h1>\n<small>{escape(suite.description)}</small>",
        _tiles(rows),
        *(html.warning(f"{r['sequence']}, seed {r['seed']}", r["reason"]) for r in _failed(rows)),
        _trajectories(rows),
        _peers(summaries(outcomes)),
        _photos(rows),
        _times(rows),
        *(
            _sequence(name, list(group))
            for name, group in groupby(outcomes, key=lambda outcome: outcome.task.entry.name)
        ),
    ]
    return html.document(title, "\n".join(parts))


def _failed(rows: Sequence[Row]) -> list[Row]:
    return [each for each in rows if each["state"] == "failed"]


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
    head = ("sequence", "seed", "posed", "ATE m", "median", "max", "RPE m/s", "deg/s", "loops", "")
    numbers = {"ate_rmse_m": 4, "ate_median_m": 4, "ate_max_m": 4, "rpe_1s_m": 4, "rpe_1s_deg": 3}
    cells = []
    for each in rows:
        if each["state"] == "failed":
            remark = f'<span class="rejected">failed</span>: {escape(each["reason"])}'
            cells.append((*_named(each), *[""] * 7, remark))
            continue
        posed = f"{each['posed']} of {each['frames']}"
        loops = f"{each['loops_accepted']} of {each['loops_tried']}"
        figures = (_number(each[key], digits) for key, digits in numbers.items())
        lost = f"no pose: {escape(each['lost'])}" if each["lost"] else ""
        cells.append((*_named(each), posed, *figures, loops, lost))
    return (
        "<h2>Trajectories</h2>\n"
        + html.table(head, cells)
        + "<p>ATE: RMSE, median and largest error of positions after SE(3) alignment, of the frames"
        " that have a pose. RPE: RMSE over 1 s. Both by the definitions of the TUM benchmark."
        " Loops: accepted of those tried.</p>"
    )


def _peers(found: Sequence[Summary]) -> str:
    """ATE of every system on every sequence; the best is bold, each source is named once."""
    systems = list(dict.fromkeys(peer.system for each in found for peer in each.peers))
    if not systems:
        return ""
    sources = list(dict.fromkeys(peer.source for each in found for peer in each.peers))
    head = ("sequence", "vnav", *map(escape, systems))
    rows = []
    for each in found:
        published = {peer.system: peer for peer in each.peers}
        known = [peer.ate_m for peer in each.peers if peer.ate_m]
        best = min([*known, *([each.median_m] if each.median_m is not None else [])], default=None)
        others = (_published(published.get(name), best, sources) for name in systems)
        rows.append((escape(each.name), _ours(each, best), *others))
    listed = "".join(f"<li>{escape(source)}</li>" for source in sources)
    return (
        "<h2>Beside published figures</h2>\n"
        + html.table(head, rows)
        + "<p>ATE RMSE in metres; of vnav the median of its runs, and the smallest to the largest."
        " Peers' figures were not measured here, but published by:</p>" + f"<ol>{listed}</ol>"
    )


def _ours(each: Summary, best: float | None) -> str:
    if each.median_m is None:
        return '<span class="rejected">failed</span>' if each.failed else "no truth"
    spread = ""
    if each.spread_m is not None:
        spread = f" ({each.ates_m[0]:.4f} to {each.ates_m[-1]:.4f})"
    if each.failed:
        spread += f', <span class="rejected">{each.failed} of {each.runs} failed</span>'
    return _emphasised(f"{each.median_m:.4f}", each.median_m == best) + spread


def _published(peer: Peer | None, best: float | None, sources: Sequence[str]) -> str:
    if peer is None:
        return ""
    ate = _emphasised(f"{peer.ate_m:g}", peer.ate_m == best) if peer.ate_m else ""
    note = escape(peer.note)
    return f"{' '.join(filter(None, (ate, note)))} <sup>{sources.index(peer.source) + 1}</sup>"


def _emphasised(text: str, best: bool) -> str:
    return f"<b>{text}</b>" if best else text


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
    stages = {"all": "", **{stage: f"_{stage}" for stage in STAGES}}
    cells = []
    for each in good:
        times = (
            f"{each[f'wall_ms{key}']:.1f} / {each[f'cpu_ms{key}']:.1f}" for key in stages.values()
        )
        machine = f"{escape(each['host'])}, {each['cores']} cores"
        cells.append((*_named(each), *times, f"{each['peak_memory_mb']:.0f} MB", machine))
    return (
        "<h2>Time and memory</h2>\n"
        + html.table(("sequence", "seed", *stages, "memory", "machine"), cells)
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
        drawn = pictures(list(runs), list(runs.values()))
        parts += [html.picture(f"{title} of {name}", png) for title, png in drawn.items()]
    for seed, run in runs.items():
        parts += [_lost(seed, run), _loops(seed, run)]
        parts.append(html.details(f"All numbers of seed {seed}", to_json(run.values)))
    for outcome in outcomes:
        if isinstance(outcome.result, Failed):
            text = f"{outcome.result.reason}\n{outcome.result.traceback}"
            parts.append(html.details(f"Why seed {outcome.task.config.seed} failed", text))
    return "\n".join(parts)


def _lost(seed: int, run: Run) -> str:
    spans = [(f"{s['first']} to {s['last']}", escape(s["reason"])) for s in run.values["lost"]]
    table = html.table((f"frames without a pose, seed {seed}", "reason"), spans)
    return table if spans else ""


def _loops(seed: int, run: Run) -> str:
    loops = run.values["loops"]
    counts = [("accepted", loops["accepted"])]
    counts += [(f"rejected: {escape(reason)}", n) for reason, n in loops["reasons"].items()]
    return html.table((f"loops, seed {seed}", "candidates"), counts)


def _named(each: Row) -> tuple[str, Any]:
    return escape(each["sequence"]), each["seed"]


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
