"""The truth about who is seen where: a mask of every frame, and who moves around that time."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import Intrinsics
from vnav.synthetic.people import Mover, Peopled

AROUND_S = 3.0  # who moves this much before or after counts as moving
SAMPLE_S = 0.1
MASKS, MOVING = "masks", "moving.txt"


def write_masks(
    folder: Path,
    people: Peopled,
    camera: Intrinsics,
    T_world_camera: NDArray[np.float64],
    times_s: NDArray[np.float64],
) -> None:
    """Write masks/NNNNNN.png of frames (N,), and moving.txt, into a folder.

    A pixel is the number of the walker at its centre, 0 where it shows none.
    """
    (folder / MASKS).mkdir()
    for k, (T, t_s) in enumerate(zip(T_world_camera, times_s, strict=True)):
        write_mask(folder, k, people.at(t_s).render_walkers(camera, T))
    write_moving(folder, people.walkers, times_s)


def write_mask(folder: Path, frame: int, walkers: NDArray[np.uint8]) -> None:
    """Write the numbers of the walkers (H, W) that a frame shows."""
    cv2.imwrite(str(folder / MASKS / _name(frame)), walkers)


def write_moving(folder: Path, walkers: Sequence[Mover], times_s: NDArray[np.float64]) -> None:
    """Write moving.txt: a mask's name, and the numbers of those who move within AROUND_S of it."""
    lines = ["# mask, walkers who move within 3 s before or after"]
    for k, moving in enumerate(moving_around(walkers, times_s)):
        lines.append(" ".join([_name(k), *map(str, moving)]))
    (folder / MOVING).write_text("\n".join(lines) + "\n", "utf-8")


def moving_around(walkers: Sequence[Mover], times_s: NDArray[np.float64]) -> list[list[int]]:
    """Numbers of those who move within AROUND_S of each time, while the capture lasts."""
    samples = np.arange(times_s[0], times_s[-1] + SAMPLE_S, SAMPLE_S)
    moves = [walker.moves_at for walker in walkers]
    table = np.array([[move(t) for move in moves] for t in samples.tolist()])
    near = np.abs(times_s[:, None] - samples) <= AROUND_S
    return [(np.flatnonzero(table[row].any(0)) + 1).tolist() for row in near]


def read_moving_masks(truth: Path) -> list[NDArray[np.bool_]]:
    """Pixels (H, W) of each frame of a capture that show somebody who moves around that time.

    ``truth``: the capture's folder of that name.
    """
    lines = (truth / MOVING).read_text("utf-8").splitlines()[1:]
    masks = []
    for name, *moving in (line.split() for line in lines):
        walkers = cv2.imread(str(truth / MASKS / name), cv2.IMREAD_UNCHANGED)
        masks.append(np.isin(np.asarray(walkers), [int(number) for number in moving]))
    return masks


def _name(frame: int) -> str:
    return f"{frame:06d}.png"
