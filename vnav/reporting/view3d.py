"""The 3D view of a map's page: one figure that carries its data and its scripts.

Without JavaScript or WebGL 2 it is a sentence. web/view.js draws it, by the library web/ogl.min.js.
"""

import json
from collections.abc import Mapping
from html import escape
from importlib import resources

from vnav.io.store.map_folder import MapFolder
from vnav.reporting.layers import Layer
from vnav.reporting.map_pictures import CUT_M
from vnav.reporting.scene import MapScene, scene, scene_beside

INSTEAD = (
    "The 3D view needs JavaScript and WebGL 2, which are not there. The pictures below show the"
    " same map from above."
)
CAPTION = (
    "Drag to turn, drag with Shift or the right button to move; with two fingers, pinch to zoom and"
    " drag to move. After a click into the view, the wheel zooms, arrows turn, Shift and arrows"
    " move, + and - zoom, T looks from above, and Home goes back."
)
BUTTONS = {
    "start": "Reset",
    "top": "Top view",
    "nearer": "+",
    "farther": "\N{MINUS SIGN}",
    "full": "Full screen",
}
NAMES = {"nearer": "nearer", "farther": "farther"}  # of buttons whose text is a sign


def figure(folder: MapFolder) -> str:
    """The view as HTML that needs nothing else, of a map whose stages up to fuse are finished."""
    return _figure(scene(folder))


def figure_beside(folder: MapFolder, addresses: Mapping[str, str]) -> str:
    """The view as HTML whose large layers are served at ``addresses``, of such a map."""
    return _figure(scene_beside(folder, addresses), "served.js")


def _figure(shown: MapScene, *more: str) -> str:
    """The view of a scene; ``more`` scripts go before its own."""
    data = json.dumps(shown.values(), sort_keys=True, allow_nan=False)
    scripts = "\n".join(f"<script>{_file(n)}</script>" for n in ("ogl.min.js", *more, "view.js"))
    return f"""<figure id="view">
<p class="instead">{INSTEAD}</p>
<canvas tabindex="0" aria-label="The map in 3D"></canvas>
<div class="controls">{_buttons()}{_cut(shown)}</div>
<div class="controls">{"".join(_switch(*item) for item in shown.layers.items())}</div>
<p class="warning" role="alert" hidden></p>
<figcaption>{CAPTION}</figcaption>
</figure>
<script type="application/json" id="view-data">{data}</script>
{scripts}"""


def style() -> str:
    """The style sheet that the figure needs."""
    return _file("view.css")


def _buttons() -> str:
    return "".join(
        f'<button type="button" value="{name}" aria-label="{NAMES.get(name, text)}">{text}</button>'
        for name, text in BUTTONS.items()
    )


def _cut(shown: MapScene) -> str:
    """The slider that takes ceilings off; it starts where the picture of the cloud is cut."""
    low, high = (float(corner[2]) for corner in (shown.low, shown.high))
    low, high = min(low, 0.0) + 0.1, high + 0.1
    start = CUT_M if low < CUT_M < high else high
    return (
        '<label class="cut">up to <input type="range" name="cut" step="any"'
        f' min="{low:.1f}" max="{high:.1f}" value="{start:.1f}"><output></output></label>'
    )


def _switch(name: str, layer: Layer) -> str:
    checked = " checked" if layer.is_shown else ""
    return (
        f'<label style="--paint: {layer.color}"><input type="checkbox" data-layer="{name}"'
        f"{checked}>{escape(layer.label)}</label>"
    )


def _file(name: str) -> str:
    return (resources.files(__package__) / "web" / name).read_text("utf-8")
