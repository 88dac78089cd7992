"""One self-contained page about a map: verdict, 3D view, numbers, pictures, loops, lost spans."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vnav import __version__
from vnav.core.mapping import LoopVerdict, Span, in_short
from vnav.errors import MapError
from vnav.io.files import write_text
from vnav.io.store.artifacts import load_loops
from vnav.io.store.map_folder import STAGES, MapFolder, to_json
from vnav.io.store.overview import overview
from vnav.reporting import html, view3d
from vnav.reporting import map_pictures as pictures
from vnav.reporting.located_photos import MOST

JPEG = (cv2.IMWRITE_JPEG_QUALITY, 85)
CAPTIONS = {
    "trajectory": "Where the camera went, from above, and which keyframes loops join.",
    "grid": "The floor plan that paths are planned on.",
    "cloud": "The cloud from above, without what is higher, as ceilings are.",
    "moving": "What moved before the camera, which the map leaves out.",
}


def write(folder: MapFolder) -> Path:
    """Write reports/report.html, pictures inlined, nothing loaded from elsewhere.

    Missing stages are named as such. MapError where the map cannot be written.
    """
    path = folder.page
    is_fused = folder.has("fuse")
    try:
        path.parent.mkdir(exist_ok=True)
        images = pictures.draw(folder) if is_fused else {}
        write_text(path, page(folder, view3d.figure(folder) if is_fused else "", images))
    except OSError as error:
        raise MapError(
            f"expected to write {path}, found: {error.strerror}; give write permission"
        ) from error
    return path


def page(folder: MapFolder, view: str, images: Mapping[str, bytes]) -> str:
    """The page as HTML, around a 3D view and pictures by name; none where it is not fused yet."""
    values = overview(folder)
    reports = {stage: folder.report(stage) for stage in ("quality", *STAGES, "map")}
    title = _title(values)
    parts = [
        f"<h1>{escape(title)}</h1>\n<small>{escape(values['map'])}, vnav {__version__}</small>",
        _map_verdict(values),
        view,
        _tiles(values),
        _warnings(reports),
        _pictures(images),
        _photos(folder.overlays()),
        _stages(values, reports),
        _lost(values),
        _loops(values, load_loops(folder) if "loops" in values else ()),
        "<h2>All numbers</h2>",
        *(html.details(name, to_json(report)) for name, report in reports.items() if report),
    ]
    return html.document(title, "\n".join(parts), view3d.style())


def _title(values: dict[str, Any]) -> str:
    names = ", ".join(capture["name"] for capture in values["captures"])
    return f"Map of {names}" if names else "A map without captures"


def _map_verdict(values: dict[str, Any]) -> str:
    """Whether the map is good; else why not, and what to do."""
    quality = values["quality"]
    if not quality:
        return html.verdict("doubtful", "No verdict", ["The map is not finished."])
    if quality["doubts"]:
        return html.verdict("doubtful", "Doubtful map", quality["doubts"])
    return html.verdict("good", "Good map", [quality.get("agreement", "")])


def _tiles(values: dict[str, Any]) -> str:
    tiles = {}
    if "frames" in values:
        tiles["frames tracked"] = f"{values['tracked']} of {values['frames']}"
        tiles["keyframes"] = values["keyframes"]
    if "loops" in values:
        tiles["loops kept"] = f"{values['loops']['accepted']} of {values['loops']['tried']}"
    if "landmarks" in values:
        tiles["landmarks"] = values["landmarks"]
        tiles["camera's path"] = f"{values['path_m']:.1f} m"
    if "grid" in values:
        tiles["free floor"] = f"{values['grid']['area_m2']['free']:.1f} m²"
    tiles["on disk"] = f"{values['size_mb']:.1f} MB"
    return html.tiles(tiles)


def _warnings(reports: dict[str, dict[str, Any]]) -> str:
    """What stages warned of; what the verdict doubts stands above."""
    found = [
        (name, text)
        for name, report in reports.items()
        for text in report.get("warnings", ())
        if name != "quality"
    ]
    return "\n".join(html.warning(name, text) for name, text in found)


def _pictures(images: Mapping[str, bytes]) -> str:
    if not images:
        return "<p>No pictures: the map is not fused yet.</p>"
    return "\n".join(_picture(*item) for item in images.items())


def _picture(name: str, data: bytes) -> str:
    """A picture as it is; that of the cloud, which is like a photo, in a third of its bytes."""
    kind = "png"
    if name == "cloud":
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        data, kind = cv2.imencode(".jpg", image, JPEG)[1].tobytes(), "jpeg"
    return html.picture(name, data, CAPTIONS[name], kind)


def _photos(overlays: Sequence[tuple[str, bytes]]) -> str:
    """What was found in the photos located last; nothing where there are none."""
    if not overlays:
        return ""
    shown = [html.picture(name, jpeg, name, "jpeg") for name, jpeg in overlays]
    return (
        "<h2>Photos located last</h2>\n<p>Blue is what the map predicts, green are features that"
        " agree with it, and yellow lines show how far they are off. Of many photos the first"
        f" {MOST} are shown.</p>\n{html.photos(shown)}"
    )


def _stages(values: dict[str, Any], reports: dict[str, dict[str, Any]]) -> str:
    rows = list[tuple[str, ...]]()
    for name, stage in values["stages"].items():
        lines = "<br>".join(escape(line) for line in reports[name].get("lines", ()))
        seconds = "" if stage["seconds"] is None else f"{stage['seconds']:.1f} s"
        state = f'<span class="{stage["state"]}">{stage["state"]}</span>'
        rows.append((name, state, seconds, f"{stage['size_mb']:.1f} MB"))
        if lines:
            rows.append((lines,))
    whole = "; ".join(escape(line) for line in reports["map"].get("lines", ()))
    table = html.table(("stage", "state", "time", "size"), rows)
    return f"<h2>Stages</h2>\n{table}\n<p>{whole}</p>"


def _lost(values: dict[str, Any]) -> str:
    if not values.get("lost"):
        return ""
    rows = [
        (span.capture, f"{span.first} to {span.last}", escape(span.reason))
        for span in in_short([Span(**lost) for lost in values["lost"]])
    ]
    return "<h2>Frames without a pose</h2>\n" + html.table(("capture", "frames", "reason"), rows)


def _loops(values: dict[str, Any], verdicts: Sequence[LoopVerdict]) -> str:
    if "loops" not in values:
        return ""
    loops = values["loops"]
    counts = [("accepted", loops["accepted"])] + [
        (f"rejected: {escape(reason)}", count) for reason, count in loops["reasons"].items()
    ]
    head = ("keyframes", "found by", "score", "matches", "inliers", "verdict")
    table = html.table(head, (_verdict(v) for v in verdicts))
    return (
        f"<h2>Loops</h2>\n<p>{loops['tried']} candidates tried, and {loops['neighbours_tried']}"
        f" pairs of neighbours, of which {loops['neighbours_accepted']} were accepted.</p>\n"
        + html.table(("verdict", "candidates"), counts)
        + f"<details><summary>Every candidate</summary>{table}</details>"
    )


def _verdict(v: LoopVerdict) -> tuple[object, ...]:
    state = "accepted" if v.accepted else "rejected"
    text = state if v.accepted else f"rejected: {escape(v.reason)}"
    verdict = f'<span class="{state}">{text}</span>'
    source = v.source if v.is_loop else f"{v.source}, neighbours"
    return f"{v.i}, {v.j}", escape(source), f"{v.score:.3f}", v.matches, v.inliers, verdict
