"""ATE of vnav on each sequence beside what was published about other systems."""

from collections.abc import Sequence
from html import escape

from vnav.evaluation.table import Summary
from vnav.io.datasets.suite_file import Peer
from vnav.reporting import html


def table(found: Sequence[Summary]) -> str:
    """A section of the page, empty without peers; the best is bold, each source is named once."""
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
        " Peers' figures are not measured here; their sources:</p>" + f"<ol>{listed}</ol>"
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
