"""What pages for people share: one self-contained file, nothing loaded from elsewhere."""

import base64
from collections.abc import Iterable, Mapping
from html import escape

NUMBER_LENGTH = 20  # at most, of a number with its unit; what is longer is a sentence

STYLE = """
:root { color-scheme: light dark; --line: #8884; --soft: #8882; --good: #2e7d32; --bad: #c62828 }
@media (prefers-color-scheme: dark) { :root { --good: #81c784; --bad: #ef9a9a } }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem }
h1 { margin-bottom: 0; overflow-wrap: anywhere } h2 { margin: 2.5rem 0 .5rem }
small { opacity: .7; overflow-wrap: anywhere }
table { border-collapse: collapse; width: 100% } .wide { overflow-x: auto }
th, td { text-align: left; padding: .25rem .75rem .25rem 0; vertical-align: top }
th, tr + tr td { border-top: 1px solid var(--line) }
.number { white-space: nowrap; font-variant-numeric: tabular-nums }
tr + tr td:only-child { border: 0; padding: 0 0 .5rem }
figure { margin: 1rem 0 } figcaption { opacity: .75; font-size: 14px }
img { display: block; width: 100%; background: #fff; border-radius: 6px; margin: .5rem 0 }
.beside { display: flex; gap: 1rem; align-items: start } .beside > * { flex: 1; min-width: 0 }
.photos { display: grid; gap: 0 1rem; grid-template-columns: repeat(auto-fill, minmax(14rem, 1fr)) }
.photos figure { margin: .25rem 0; min-width: 0 } .photos figcaption { overflow-wrap: anywhere }
pre { overflow-x: auto; font-size: 13px }
.tiles { display: flex; flex-wrap: wrap; gap: .75rem; margin: 1.5rem 0 }
.tile { flex: 1 1 6.5rem; padding: .6rem .75rem; border-radius: 8px; background: var(--soft) }
.tile b { display: block; font-size: 1.25rem; white-space: nowrap }
.warning { padding: .5rem .9rem; border-left: 4px solid #e65100; background: #e6510018 }
.verdict { padding: .6rem .9rem; border-left: 4px solid; border-radius: 4px; margin: 1.25rem 0 }
.verdict p { margin: .3rem 0 0 } .verdict b { font-size: 1.25rem }
.good { border-color: var(--good); background: #2e7d3218 }
.doubtful { border-color: #e65100; background: #e6510018 }
.current, .accepted { color: var(--good) }
.stale, .damaged, .missing, .rejected { color: var(--bad) }
"""


def document(title: str, body: str, style: str = "") -> str:
    """The whole page; ``title`` is text, ``body`` HTML, ``style`` what its own figures need."""
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{STYLE}{style}</style>'
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


def verdict(state: str, title: str, reasons: Iterable[str]) -> str:
    """What matters most, first; ``state`` is "good" or "doubtful"."""
    lines = "".join(f"<p>{escape(reason)}</p>" for reason in reasons)
    return f'<div class="verdict {state}"><b>{escape(title)}</b>{lines}</div>'


def warning(name: str, text: str) -> str:
    """A line that stands out."""
    return f'<p class="warning"><b>{escape(name)}</b>: {escape(text)}</p>'


def table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A table whose cells are HTML already; the last one of a short row is as wide as it takes."""
    columns = list(head)
    top = "".join(f"<th>{cell}</th>" for cell in columns)
    lines = "\n".join(_row(list(row), len(columns)) for row in rows)
    return f'<div class="wide"><table>\n<tr>{top}</tr>\n{lines}\n</table></div>'


def _row(cells: list[object], width: int) -> str:
    *first, last = (str(cell) for cell in cells)
    span = f" colspan={width - len(first)}" if len(cells) < width else ""
    return "<tr>" + "".join(_cell(cell) for cell in first) + _cell(last, span) + "</tr>"


def _cell(text: str, span: str = "") -> str:
    """A cell; a number with its unit does not wrap."""
    is_number = text[:1].isdigit() and len(text) <= NUMBER_LENGTH
    number = ' class="number"' if is_number else ""
    return f"<td{number}{span}>{text}</td>"


def beside(*parts: str) -> str:
    """Pictures side by side."""
    return f'<div class="beside">{"".join(parts)}</div>'


def photos(parts: Iterable[str]) -> str:
    """Small pictures, as many beside each other as there is room for."""
    return f'<div class="photos">{"".join(parts)}</div>'


def details(name: str, text: str) -> str:
    """Text that is shown when its name is clicked."""
    return f"<details><summary>{escape(name)}</summary><pre>{escape(text)}</pre></details>"


def picture(name: str, data: bytes, caption: str = "", kind: str = "png") -> str:
    """A picture, a "png" or a "jpeg", inlined; ``caption`` is text below it."""
    text = base64.b64encode(data).decode()
    image = f'<img alt="{escape(name)}" src="data:image/{kind};base64,{text}">'
    if not caption:
        return image
    return f"<figure>{image}<figcaption>{escape(caption)}</figcaption></figure>"
