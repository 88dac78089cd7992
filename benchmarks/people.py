"""Maps of rendered rooms that people walk through, beside maps of the same walks without them.

    python benchmarks/people.py OUT [--scenes one_room apartment] [--seeds 5] [--peer NAME=DIR]

renders captures to OUT/captures and maps them to OUT/maps, each once. It counts frames with a pose,
scores the trajectory, and looks for ghosts: occupied cells of the octree where there truly is
nothing, cells of the grid that stand in a robot's way, and area of the mesh far from any true
surface. A DIR of a peer has its trajectories of the same captures, as CAPTURE.tum. What masks cover
is measured by masks.py, on the same captures. Exit code 1 where something wanted is missed.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from accuracy import built, frames_of, poses_in, vnav
from numpy.typing import NDArray
from recording import Measurement, add_record_option, conclude
from scipy.ndimage import distance_transform_edt

from vnav.core import se3
from vnav.core.grid import FREE, OCCUPIED, Grid
from vnav.core.point_cloud import Mesh
from vnav.io.formats.grid_files import read_grid
from vnav.io.formats.ply import read_mesh
from vnav.synthetic import SCENES, CaptureSpec, Scene, write_capture
from vnav.synthetic.raycast import Rectangles
from vnav.synthetic.rendered_capture import KINECT, PHONE
from vnav.volumes.octree import Leaves, Octree

Array = NDArray[np.float64]

WALKERS = {0.0: 0, 0.10: 2, 0.20: 3, 0.35: 4}  # by the share of the pixels that they cover
FRAMES = {"one_room": 150, "apartment": 300}
TIMES_ATE, TIMES_GHOSTS = 1.5, 1.2  # of the walk without people
FAR_M = 0.05  # from any true surface
BESIDE_CELLS = 2.0  # of the grid: so near to what truly stands there, an obstacle is no ghost
AT_ONCE = 1000  # points


def spec_of(scene: str, share: float, seed: int, width: int) -> CaptureSpec:
    """A walk of 10 frames a second; everything but the people is the same for all shares."""
    camera = KINECT.scaled(width, 3 * width // 4)
    spec = CaptureSpec(scene, FRAMES[scene], 8, camera, PHONE, seed=seed)
    if scene == "one_room":
        spec = replace(spec, height_m=1.1, pitch_deg=-20.0)
    return replace(spec, walkers=WALKERS[share], walker_share=share)


def name_of(scene: str, share: float, seed: int) -> str:
    """What such a walk's folders are called."""
    return f"{scene}_people{round(100 * share):02d}_seed{seed}"


def rendered(folder: Path, spec: CaptureSpec) -> Path:
    """The capture's folder, written where it is not there."""
    if not folder.is_dir():
        draft = folder.with_name(f"{folder.name}.draft")
        write_capture(draft, spec)
        draft.rename(folder)
    return folder


def distance_m(points: Array, faces: Rectangles) -> Array:
    """From points (N, 3) to the nearest of the rectangles (N,)."""
    found = [np.zeros(0)]
    for start in range(0, len(points), AT_ONCE):
        off = points[start : start + AT_ONCE, None] - faces.corner
        for edge in (faces.u_edge, faces.v_edge):
            along = np.clip((off * edge).sum(-1) / (edge**2).sum(-1), 0, 1)
            off -= along[..., None] * edge
        found.append(np.linalg.norm(off, axis=-1).min(1))
    return np.concatenate(found)


def occupied_cells(leaves: Leaves, cell_m: float) -> Array:
    """Centres (N, 3) of the occupied cells of the finest size; larger leaves are many of them."""
    cells = [np.zeros((0, 3))]
    for size_m in np.unique(leaves.size_m):
        centres = leaves.centres_world[leaves.occupied & (leaves.size_m == size_m)]
        side = (np.arange(round(size_m / cell_m)) + 0.5) * cell_m - size_m / 2
        inside = np.stack(np.meshgrid(side, side, side), -1).reshape(-1, 3)
        cells.append((centres[:, None] + inside).reshape(-1, 3))
    return np.concatenate(cells)


def ghost_cells(octree: Octree, T_truth_world: Array, scene: Scene) -> int:
    """Occupied cells that touch no true surface, whichever way the map's cells lie in the world."""
    cell_m = octree.resolution_m
    cells = se3.transform(T_truth_world, occupied_cells(octree.leaves(), cell_m))
    return int((distance_m(cells, scene.rectangles) > np.sqrt(3) / 2 * cell_m).sum())


def ghosts_in_the_way(grid: Grid, T_truth_world: Array, truth: Grid) -> int:
    """Occupied cells of the grid where truly nothing stands, nor beside."""
    x_y = grid.centres_of(np.argwhere(grid.cells == OCCUPIED))
    centres = np.column_stack([x_y, np.zeros(len(x_y))])
    cells = truth.cells_at(se3.transform(T_truth_world, centres)[:, :2])
    row, column = cells[truth.contains(cells)].T
    away = distance_transform_edt(truth.cells != OCCUPIED)
    is_free = truth.cells[row, column] == FREE
    return int((is_free & (away[row, column] > BESIDE_CELLS)).sum())


def of_grid(on: str, what: str, capture: Path, map_of: Path, T_truth_world: Array) -> Measurement:
    """The ghosts of a map's grid."""
    grid, truth = (read_grid(f / "grid.yaml") for f in (map_of / "fuse", capture / "truth"))
    ghosts = ghosts_in_the_way(grid, T_truth_world, truth)
    return Measurement(on, what, "ghost cells of the grid", ghosts)


def ghost_area_m2(mesh: Mesh, T_truth_world: Array, scene: Scene) -> float:
    """Area of the triangles whose middle is farther than FAR_M from any true surface."""
    a, b, c = np.moveaxis(mesh.vertices_world[mesh.triangles].astype(float), 1, 0)
    area_m2 = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    middles = se3.transform(T_truth_world, (a + b + c) / 3)
    return float(area_m2[distance_m(middles, scene.rectangles) > FAR_M].sum())


def of_trajectory(on: str, what: str, capture: Path, file: Path) -> tuple[list[Measurement], Array]:
    """Frames with a pose and ATE of a TUM file, and T_truth_world of its world."""
    score, frames = vnav("score", file, capture / "groundtruth.txt"), frames_of(capture)
    return [
        Measurement(on, what, "frames", frames),
        Measurement(on, what, "frames with a pose", poses_in(file), "", f"at least {frames}"),
        Measurement(on, what, "ATE RMSE", score["ate_m"]["rmse"], "m"),
    ], np.array(score["T_truth_world"])


def of_map(on: str, what: str, capture: Path, map_of: Path, scene: Scene) -> list[Measurement]:
    """All that is measured of a map, without what is wanted in comparison."""
    file = map_of / "optimise" / "trajectory_0.tum"
    found, T_truth_world = of_trajectory(on, what, capture, file)
    octree, mesh = Octree.read(map_of / "fuse" / "occupancy.ot"), map_of / "fuse" / "mesh.ply"
    cells = ghost_cells(octree, T_truth_world, scene)
    area_m2 = ghost_area_m2(read_mesh(mesh), T_truth_world, scene)
    return [
        *found,
        Measurement(on, what, "ghost cells", cells),
        of_grid(on, what, capture, map_of, T_truth_world),
        Measurement(on, what, "mesh off the truth", area_m2, "m2"),
    ]


def held_against(empty: Sequence[Measurement], found: Sequence[Measurement]) -> list[Measurement]:
    """What was found with people, and what the walk without them lets one want."""
    times = {
        "ATE RMSE": TIMES_ATE,
        "ghost cells": TIMES_GHOSTS,
        "ghost cells of the grid": TIMES_GHOSTS,
        "mesh off the truth": TIMES_GHOSTS,
    }
    limits = {m.quantity: times[m.quantity] * m.value for m in empty if m.quantity in times}
    return [
        replace(m, wanted=f"at most {limits[m.quantity]:.4g}") if m.quantity in limits else m
        for m in found
    ]


def walks(asked: argparse.Namespace, scene: str, seed: int) -> Iterator[Measurement]:
    """One walk with every share of people, the first without any."""
    on, place = f"{scene}, seed {seed}", SCENES[scene](seed)
    empty: list[Measurement] = []
    for share in (0.0, *asked.shares):
        name = name_of(scene, share, seed)
        capture = rendered(asked.out / "captures" / name, spec_of(scene, share, seed, asked.width))
        map_of = asked.out / "maps" / name
        built(capture, map_of)
        who = f"{share:.0%} people" if share else "no people"
        found = of_map(on, f"vnav, {who}", capture, map_of, place)
        empty = empty or found
        yield from held_against(empty, found) if share else found
        for peer, folder in asked.peer:
            file = folder / f"{name}.tum"
            if file.is_file():
                theirs, _ = of_trajectory(on, f"{peer}, {who}", capture, file)
                yield from (replace(m, wanted=None) for m in theirs)


def peer(text: str) -> tuple[str, Path]:
    """NAME=DIR taken apart."""
    name, equals, folder = text.partition("=")
    if not equals or not Path(folder).is_dir():
        raise argparse.ArgumentTypeError(f"expected NAME=DIR, a folder, found {text!r}")
    return name, Path(folder)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, help="of captures and maps, which are made once")
    parser.add_argument("--scenes", nargs="+", choices=list(FRAMES), default=list(FRAMES))
    parser.add_argument(
        "--shares", nargs="+", type=float, choices=list(WALKERS), default=list(WALKERS)[1:]
    )
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--width", type=int, default=640, help="of the images, in pixels")
    parser.add_argument("--peer", type=peer, action="append", default=[], metavar="NAME=DIR")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    for name in ("captures", "maps"):
        (asked.out / name).mkdir(parents=True, exist_ok=True)
    pairs = [(scene, seed) for scene in asked.scenes for seed in range(asked.seeds)]
    found = [m for scene, seed in pairs for m in walks(asked, scene, seed)]
    return conclude("people", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
