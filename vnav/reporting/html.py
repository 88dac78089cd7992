"""What pages for people share: one self-contained file, nothing loaded from elsewhere."""

import base64
from collections.abc import Iterable, Mapping
from html import escape

STYLE = """
:root { color-scheme: light dark; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem }
h1 { margin-bottom: 0 } h2 { margin: 2.5rem 0 .5rem } small { opacity: .7 }
table { border-collapse: collapse; width: 100% }
th, td { text-align: left; padding: .25rem .75rem .25rem 0; vertical-align: top }
th, tr + tr td { border-top: 1px solid #8884 }
img { width: 100%; background: #fff; border-radius: 6px; margin: .5rem 0 }
.beside { display: flex; gap: 1rem; align-items: start } .beside img { flex: 1; min-width: 0 }
pre { overflow-x: auto; font-size: 13px }
.tiles { display: flex; flex-wrap: wrap; gap: .75rem; margin: 1.5rem 0 }
.tile { flex: 1 1 8rem; padding: .6rem .9rem; border-radius: 8px; background: #8882 }
.tile b { display: block; font-size: 1.35rem }
.warning { padding: .5rem .9rem; border-left: 4px solid #e65100; background: #e6510018 }
.current, .accepted { color: #2e7d32 } .stale, .missing, .rejected { color: #c62828 }
"""


def document(title: str, body: str) -> str:
    """The whole page; ``title`` is text, ``body`` HTML."""
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{STYLE}</style>'
    head += '<meta name="viewport" content="width=device-width">'
    return (
        f"<!doctype html>\n<html lang=en>\n<head>{head}</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def tiles(values: Mapping[str, object]) -> str:
    """The few numbers that matter most, large."""
    cells = (
        f'<div class="tile"><b>{escape(str(value))}</b>{escape(name)}</div>'
        for name, value in values.items()
    )
    return f'<div class="tiles">{"".join(cells)}</div>'


def warning(name: str, text: str) -> str:
    """A line that stands out."""
    return f'<p class="warning"><b>{escape(name)}</b>: {escape(text)}</p>'


def table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A table whose cells are HTML already; the last one of a short row is as wide as it takes."""
    columns = list(head)
    top = "".join(f"<th>{cell}</th>" for cell in columns)
    lines = "\n".join(_row(list(row), len(columns)) for row in rows)
    return f"<table>\n<tr>{top}</tr>\n{lines}\n</table>"


def _row(cells: list[object], width: int) -> str:
    *first, last = cells
    span = f" colspan={width - len(first)}" if len(cells) < width else ""
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in first) + f"<td{span}>{last}</td></tr>"


def beside(*parts: str) -> str:
    """Pictures side by side."""
    return f'<div class="beside">{"".join(parts)}</div>'


def details(name: str, text: str) -> str:
    """Text that is shown when its name is clicked."""
    return f"<details><summary>{escape(name)}</summary><pre>{escape(text)}</pre></details>"


def picture(name: str, png: bytes) -> str:
    """A picture, inlined."""
    data = base64.b64encode(png).decode()
    return f'<img alt="{escape(name)}" src="data:image/png;base64,{data}">'
