"""Parts of a map in formats that no stage writes; each writes into a folder and says what."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from vnav.core.grid import FREE
from vnav.core.point_cloud import PointCloud
from vnav.core.posed_images import PosedImages
from vnav.io.files import copy_into, write_bytes
from vnav.io.formats.colmap import write_model
from vnav.io.formats.gltf import write_glb
from vnav.io.formats.grid_files import write_keepout
from vnav.io.formats.las import write_las
from vnav.io.formats.ply import write_cloud, write_obj
from vnav.io.formats.transforms import DEPTH_UNITS_PER_METRE, write_transforms
from vnav.io.store.artifacts import load_cloud, load_grid, load_keyframe_depth, load_mesh
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.places_file import load_zones
from vnav.io.store.posed_keyframes import load_posed_keyframes
from vnav.io.store.viewed_map import write_viewed_map


def obj(folder: MapFolder, out: Path) -> list[Path]:
    """The mesh as Wavefront OBJ."""
    write_obj(out / "mesh.obj", load_mesh(folder))
    return [out / "mesh.obj"]


def glb(folder: MapFolder, out: Path) -> list[Path]:
    """The mesh as binary glTF."""
    write_glb(out / "mesh.glb", load_mesh(folder))
    return [out / "mesh.glb"]


def las(folder: MapFolder, out: Path) -> list[Path]:
    """The cloud as LAS."""
    write_las(out / "cloud.las", load_cloud(folder))
    return [out / "cloud.las"]


def colmap(folder: MapFolder, out: Path) -> list[Path]:
    """A model in the folders that COLMAP and its readers expect, beside the images."""
    views, sparse = load_posed_keyframes(folder), out / "sparse" / "0"
    sparse.mkdir(parents=True, exist_ok=True)
    return [_images(folder, views, out), *write_model(sparse, views)]


def transforms(folder: MapFolder, out: Path) -> list[Path]:
    """Poses and cameras, images and depth, and the landmarks as a cloud to begin with."""
    views = load_posed_keyframes(folder)
    colors, depths = _images(folder, views, out), _depths(folder, views, out)
    path, cloud = out / "transforms.json", out / "landmarks.ply"
    write_cloud(cloud, PointCloud(views.landmarks.points_world, views.colors))
    write_transforms(path, views, colors.name, depths.name, cloud.name)
    return [colors, depths, cloud, path]


def rerun(folder: MapFolder, out: Path) -> list[Path]:
    """All that is seen of the map, as a recording for rerun."""
    write_viewed_map(folder, out / "map.rrd")
    return [out / "map.rrd"]


def keepout(folder: MapFolder, out: Path) -> list[Path]:
    """A mask as large as the grid, occupied where the map's keep-outs are and free elsewhere."""
    grid = load_grid(folder)
    nothing = replace(grid, cells=np.full_like(grid.cells, FREE))
    write_keepout(out, nothing.blocked(load_zones(folder).keep_out.values()))
    return [out / "keepout.pgm", out / "keepout.yaml"]


def _images(folder: MapFolder, views: PosedImages, out: Path) -> Path:
    """A folder of the keyframes' colour images."""
    (out / "images").mkdir(exist_ok=True)
    for image in views.images:
        copy_into(out / "images", folder.file("odometry", f"keyframes/{image.name}.jpg"))
    return out / "images"


def _depths(folder: MapFolder, views: PosedImages, out: Path) -> Path:
    """A folder of their depth, 16 bits, 0 where there is none."""
    (out / "depths").mkdir(exist_ok=True)
    for image in views.images:
        depth = np.rint(load_keyframe_depth(folder, image.row) * DEPTH_UNITS_PER_METRE)
        _, data = cv2.imencode(".png", depth.astype(np.uint16))
        write_bytes(out / "depths" / f"{image.name}.png", data.tobytes())
    return out / "depths"
