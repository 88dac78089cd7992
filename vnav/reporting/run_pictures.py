"""Pictures of the runs of one sequence: paths beside the truth, error over time, loops."""

import io
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.association import associate
from vnav.evaluation.sequence import SequenceRun
from vnav.reporting.figures import legend, map_figure

MARGIN_M = 0.3
WIDE_IN = 5.5  # two are shown side by side
GAP = 3.5  # times the usual step: there poses are missing, and no line is drawn
COLORS = colormaps["tab10"].colors  # type: ignore[attr-defined]
TRUTH = "#263238"


def pictures(runs: Mapping[int, SequenceRun]) -> dict[str, bytes]:
    """PNG of each picture by its name, of runs by their seed; errors only where there is a truth.

    Seen from above, in the world of the first run's map, whose z is up; the others are brought
    there by way of the truth, without which they are left out.
    """
    seed, first = next(iter(runs.items()))
    shown = runs if len(first.truth) else {seed: first}
    figures = {"trajectories": _trajectories(shown), "loops": _loops(seed, first)}
    if len(first.truth):
        figures["error over time"] = _errors(shown)
    return {name: _png(figure) for name, figure in figures.items()}


def _trajectories(runs: Mapping[int, SequenceRun]) -> Figure:
    first = next(iter(runs.values()))
    T_first_truth = se3.inverse(_T_truth_world(first))
    truth = se3.transform(T_first_truth, first.truth.positions)
    paths = [
        se3.transform(T_first_truth @ _T_truth_world(run), run.trajectory.positions)
        for run in runs.values()
    ]
    figure, axes = map_figure(_extent([*paths, truth]), "Trajectories, from above", WIDE_IN)
    entries = []
    if len(truth):
        axes.plot(*_broken(first.truth.stamps_s, truth)[:, :2].T, color=TRUTH, lw=2.5, alpha=0.4)
        entries.append(Line2D([], [], color=TRUTH, lw=2.5, alpha=0.4, label="truth"))
    for (seed, run), path, color in zip(runs.items(), paths, _colors(runs), strict=True):
        axes.plot(*_broken(run.trajectory.stamps_s, path)[:, :2].T, color=color, lw=1)
        entries.append(Line2D([], [], color=color, lw=1, label=f"vnav, seed {seed}"))
    legend(figure, entries)
    return figure


def _loops(seed: int, run: SequenceRun) -> Figure:
    """Accepted closures of one run, drawn between the places they join."""
    path = run.trajectory.positions
    title = f"Accepted loops of seed {seed} ({len(run.closures_s)})"
    figure, axes = map_figure(_extent([path]), title, WIDE_IN)
    axes.plot(*_broken(run.trajectory.stamps_s, path)[:, :2].T, color="#90a4ae", lw=1.2)
    ends = np.searchsorted(run.trajectory.stamps_s, run.closures_s - 1e-6)
    ends = ends.clip(0, len(path) - 1)
    axes.add_collection(LineCollection(list(path[ends, :2]), colors="#8e24aa", lw=0.6, alpha=0.5))
    return figure


def _errors(runs: Mapping[int, SequenceRun]) -> Figure:
    figure = Figure((11, 3), layout="constrained")
    axes = figure.add_subplot(xlabel="time / s", ylabel="position error / cm")
    axes.spines[["top", "right"]].set_visible(False)
    start_s = min(run.trajectory.stamps_s[0] for run in runs.values())
    for (seed, run), color in zip(runs.items(), _colors(runs), strict=True):
        stamps_s, errors_m = _off(run)
        rmse_m = run.values["score"]["ate_m"]["rmse"]
        line = _broken(stamps_s, np.stack([stamps_s - start_s, 100 * errors_m], 1))
        axes.plot(*line.T, color=color, lw=1, label=f"seed {seed}: ATE {100 * rmse_m:.2f} cm")
    axes.set_ylim(bottom=0)
    figure.legend(frameon=False, ncols=5, loc="outside upper left")
    return figure


def _off(run: SequenceRun) -> tuple[Array, Array]:
    """Times (M,) and distances (M,) between aligned estimated and true positions."""
    matches = associate(run.trajectory.stamps_s, run.truth.stamps_s, 1e-6)
    aligned = se3.transform(_T_truth_world(run), run.trajectory.positions[matches[:, 0]])
    off = np.linalg.norm(aligned - run.truth.positions[matches[:, 1]], axis=1)
    return run.truth.stamps_s[matches[:, 1]], off


def _T_truth_world(run: SequenceRun) -> Array:
    score = run.values["score"]
    return np.array(score["T_truth_world"]) if score else np.eye(4)


def _broken(stamps_s: Array, points: Array) -> Array:
    """Points (N, K) with a row of NaN wherever times leap."""
    steps = np.diff(stamps_s)
    usual_s = np.median(steps) if len(steps) else 0.0
    leaps = np.flatnonzero(steps > GAP * usual_s) + 1
    return np.insert(points, leaps, np.nan, axis=0)


def _extent(paths: Sequence[Array]) -> tuple[float, float, float, float]:
    xy = np.concatenate(paths)[:, :2]
    (left, bottom), (right, top) = xy.min(0) - MARGIN_M, xy.max(0) + MARGIN_M
    return float(left), float(right), float(bottom), float(top)


def _colors(runs: Mapping[int, SequenceRun]) -> list[tuple[float, float, float]]:
    return [COLORS[k % len(COLORS)] for k in range(len(runs))]


def _png(figure: Figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png", bbox_inches="tight", dpi=130)
    return file.getvalue()
