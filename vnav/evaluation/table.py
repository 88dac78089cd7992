"""The runs of an evaluation as flat rows, and each sequence over its seeds."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from statistics import median
from typing import Any

from vnav.core.report import Failed
from vnav.evaluation.metrics import NEAR
from vnav.evaluation.stored_runs import Outcome
from vnav.io.datasets.suite_file import Peer
from vnav.io.store.map_folder import STAGES

Row = dict[str, Any]
QUERIES = {"photos": "photos", "held-out frames": "held_out"}  # and what columns call them


@dataclass(frozen=True)
class Summary:
    """A sequence over its seeds; ``ates_m``: ATE RMSE of each run that has one, ascending."""

    name: str
    runs: int
    failed: int
    ates_m: tuple[float, ...]
    peers: tuple[Peer, ...]

    @property
    def median_m(self) -> float | None:
        """Median ATE RMSE, None without one."""
        return median(self.ates_m) if self.ates_m else None

    @property
    def spread_m(self) -> float | None:
        """Largest less smallest ATE RMSE, None for fewer than two."""
        return self.ates_m[-1] - self.ates_m[0] if len(self.ates_m) > 1 else None


def summaries(outcomes: Sequence[Outcome]) -> list[Summary]:
    """One for each sequence, in order."""
    return [
        _summary(list(group)) for _, group in groupby(outcomes, key=lambda o: o.task.entry.name)
    ]


def row(outcome: Outcome) -> Row:
    """A run as one flat row; times are milliseconds a frame. None for what is not known."""
    task, result = outcome.task, outcome.result
    named = {"sequence": task.entry.name, "seed": task.config.seed}
    if isinstance(result, Failed):
        return named | {"state": "failed", "reason": result.reason}
    v = result.values
    return {
        **named,
        "state": "ok",
        "reason": "",
        **{key: v[key] for key in ("frames", "tracked", "posed", "keyframes")},
        "posed_share": v["posed"] / v["frames"],
        "lost": "; ".join(f"{s['first']}-{s['last']}: {s['reason']}" for s in v["lost"]),
        **_score(v["score"]),
        **{f"loops_{key}": v["loops"][key] for key in ("tried", "accepted", "rejected")},
        "loops_reasons": "; ".join(f"{r}: {n}" for r, n in v["loops"]["reasons"].items()),
        **_times(v["seconds"], v["frames"]),
        **{key: v[key] for key in ("peak_memory_mb", "map_mb", "landmarks", "path_m")},
        **{key: v[key] for key in ("host", "cores")},
        **_queries(v["relocalisation"]),
    }


def within(each: Row, column: str) -> list[str]:
    """Shares of a row's photos within each limit, as text."""
    shares = (each[f"{column}_within_{100 * m:.0f}cm_{deg:.0f}deg"] for m, deg in NEAR)
    return [f"{100 * share:.0f} %" for share in shares]


def limits() -> list[str]:
    """The limits of `metrics.NEAR` as text."""
    return [f"{100 * m:.0f} cm, {deg:.0f} deg" for m, deg in NEAR]


def _summary(outcomes: list[Outcome]) -> Summary:
    entry = outcomes[0].task.entry
    runs = [o.result for o in outcomes if not isinstance(o.result, Failed)]
    scores = [run.values["score"] for run in runs]
    ates_m = sorted(score["ate_m"]["rmse"] for score in scores if score)
    return Summary(entry.name, len(outcomes), len(outcomes) - len(runs), tuple(ates_m), entry.peers)


def _score(score: dict[str, Any] | None) -> Row:
    if score is None:
        return dict.fromkeys(("ate_rmse_m", "ate_median_m", "ate_max_m", "rpe_1s_m", "rpe_1s_deg"))
    ate, rpe = score["ate_m"], score["rpe"]["1 s"]
    return {
        "pairs": score["pairs"],
        "ate_rmse_m": ate["rmse"],
        "ate_median_m": ate["median"],
        "ate_max_m": ate["max"],
        "rpe_1s_m": rpe["translation_m"]["rmse"] if rpe["pairs"] else None,
        "rpe_1s_deg": rpe["rotation_deg"]["rmse"] if rpe["pairs"] else None,
    }


def _times(seconds: dict[str, dict[str, float]], frames: int) -> Row:
    """Milliseconds a frame, of all and of each stage."""
    return {
        f"{clock}_ms{'' if stage == 'map' else '_' + stage}": 1000 * seconds[stage][clock] / frames
        for clock in ("wall", "cpu")
        for stage in ("map", *STAGES)
    }


def _queries(found: dict[str, dict[str, Any]]) -> Row:
    values: Row = {}
    for name, column in QUERIES.items():
        if name not in found:
            continue
        of = found[name]
        values |= {column: of["photos"], f"{column}_located": of["located"]}
        for (m, deg), share in zip(NEAR, of["within"], strict=True):
            values[f"{column}_within_{100 * m:.0f}cm_{deg:.0f}deg"] = share
        for key in ("wrong", "median_m", "median_deg"):
            values[f"{column}_{key}"] = of[key]
        values[f"{column}_refused"] = of["photos"] - of["located"]
    return values
