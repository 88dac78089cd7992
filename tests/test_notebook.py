"""The cells of docs/vnav.ipynb run in turn, with a capture and a map that other tests share."""

import ast
import functools
import json
import shutil
from pathlib import Path

import matplotlib as mpl
import pytest

from vnav import synthetic

NOTEBOOK = json.loads((Path(__file__).parent.parent / "docs" / "vnav.ipynb").read_text("utf-8"))
CELLS = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]


def run(cell: str, names: dict[str, object]) -> object:
    """What a cell ends with, which a notebook shows."""
    body = ast.parse(cell).body
    last = body.pop() if isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), "cell", "exec"), names)  # noqa: S102
    if last is None:
        return None
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)  # noqa: S307


def test_the_cells_run_one_after_the_other(
    tiny_capture: Path, whole_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rendered = functools.partial(synthetic.cached_capture, cache=tiny_capture.parent.parent)
    monkeypatch.setattr(synthetic, "cached_capture", rendered)
    monkeypatch.chdir(tmp_path)
    shutil.copytree(whole_map, tmp_path / "room" / "map")
    mpl.use("agg")
    names = dict[str, object]()
    shown = [run("".join(cell["source"]), names) for cell in CELLS]
    pictures = [made._repr_mimebundle_() for made in shown if hasattr(made, "_repr_mimebundle_")]
    assert len(pictures) == 3
    assert names["capture"] == tiny_capture
    assert all(report.reused for report in names["room"].built.reports)  # type: ignore[attr-defined]
    assert names["answer"].located  # type: ignore[attr-defined]
    assert names["path"].found is not None  # type: ignore[attr-defined]
    assert names["score"].ate.translation_m.rmse < 0.01  # type: ignore[attr-defined]


def test_it_has_ten_cells_without_outputs() -> None:
    assert len(NOTEBOOK["cells"]) == 10
    assert not [cell for cell in CELLS if cell["outputs"] or cell["execution_count"] is not None]
