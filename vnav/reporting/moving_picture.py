"""The keyframes in which most moves, with what is masked in them."""

import numpy as np
from matplotlib.figure import Figure

from vnav.core.mapping import Odometry
from vnav.io.store.artifacts import load_keyframe, load_keyframe_mask
from vnav.io.store.map_folder import MapFolder

SHOWN = 4
RED = np.array([229, 57, 53])


def moving_figure(folder: MapFolder, odometry: Odometry) -> Figure | None:
    """Up to four keyframes, most first, what is masked in red; None where nothing is."""
    if not len(odometry.moving_share):
        return None
    share = np.nan_to_num(odometry.moving_share)
    rows = [row for row in odometry.keyframe_rows.tolist() if share[row] > 0]
    rows = sorted(rows, key=lambda row: -float(share[row]))[:SHOWN]
    if not rows:
        return None
    figure = Figure((10, 2 + 2.5 * len(rows) / 2), dpi=150, layout="constrained")
    figure.suptitle("What moves, and is left out")
    for axes, row in zip(
        figure.subplots(-(-len(rows) // 2), 2, squeeze=False).flat, rows, strict=False
    ):
        color = load_keyframe(folder, row, odometry.frames).color
        moving = load_keyframe_mask(folder, row, color.shape[:2])[..., None]
        axes.imshow(np.where(moving, (color + RED) // 2, color))
        axes.set_title(f"frame {odometry.frames.index[row]}: {share[row]:.0%}", fontsize=9)
    for axes in figure.axes:
        axes.set_axis_off()
    return figure
