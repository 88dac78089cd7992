"""Surfaces as binary glTF 2.0: registry.khronos.org/glTF/specs/2.0.

y is up there, colours of vertices are linear, and a material without lighting
(KHR_materials_unlit) shows what the camera saw.
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.core.point_cloud import Mesh
from vnav.io.files import write_bytes

FLOAT, SHORT, INDEX = 5126, 5123, 5125  # component types: float32, uint16, uint32
VERTICES, TRIANGLES = 34962, 34963  # targets of buffers
VERSION, JSON_CHUNK, BINARY_CHUNK = 2, b"JSON", b"BIN\0"
R_GLTF_WORLD = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], np.float32)  # y up, x stays


def write_glb(path: Path, mesh: Mesh) -> None:
    """Write positions, normals, colours and triangles; a mesh of nothing is a scene of nothing."""
    arrays = {
        "POSITION": mesh.vertices_world @ R_GLTF_WORLD.T,
        "NORMAL": mesh.normals_world @ R_GLTF_WORLD.T,
        "COLOR_0": _linear(mesh.colors),
        "indices": mesh.triangles.astype(np.uint32).reshape(-1, 1),
    }
    blocks = [np.ascontiguousarray(values).tobytes() for values in arrays.values()]
    scene = _scene(arrays) if len(mesh.triangles) else {"scenes": [{"nodes": []}]}
    binary = _chunk(BINARY_CHUNK, b"".join(blocks), b"\0") if len(mesh.triangles) else b""
    asset = {"asset": {"version": "2.0", "generator": "vnav"}, "scene": 0}
    body = _chunk(JSON_CHUNK, json.dumps({**asset, **scene}).encode(), b" ") + binary
    write_bytes(path, struct.pack("<4sII", b"glTF", VERSION, 12 + len(body)) + body)


def _linear(colors: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Linear RGBA (N, 4) of 16 bits from sRGB (N, 3): IEC 61966-2-1. 8 bits would band shadows."""
    c = np.arange(256) / 255
    table = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    linear = np.rint(65535 * table).astype(np.uint16)[colors]
    return np.hstack([linear, np.full((len(linear), 1), 65535, np.uint16)])


def _scene(arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """One node of one mesh, whose arrays lie in the buffer one after another."""
    accessors: list[dict[str, Any]] = []
    views: list[dict[str, int]] = []
    begin = 0
    for name, values in arrays.items():
        target = TRIANGLES if name == "indices" else VERTICES
        views.append(
            {"buffer": 0, "byteOffset": begin, "byteLength": values.nbytes, "target": target}
        )
        accessors.append({"bufferView": len(accessors), **_layout(name, values)})
        begin += values.nbytes
    names = list(arrays)
    primitive = {
        "attributes": {name: names.index(name) for name in names if name != "indices"},
        "indices": names.index("indices"),
        "material": 0,
    }
    surface = {"metallicFactor": 0, "roughnessFactor": 1}
    material = {"pbrMetallicRoughness": surface, "extensions": {"KHR_materials_unlit": {}}}
    return {
        "extensionsUsed": ["KHR_materials_unlit"],
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "mesh"}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [{**material, "doubleSided": True}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": begin}],
    }


def _layout(name: str, values: NDArray[Any]) -> dict[str, Any]:
    """What an accessor says of an array; that of positions has bounds."""
    components = {np.dtype("f4"): FLOAT, np.dtype("u2"): SHORT, np.dtype("u4"): INDEX}
    kind = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[values.shape[1]]
    count = {"componentType": components[values.dtype], "count": len(values), "type": kind}
    if name == "POSITION":
        return {**count, "min": values.min(0).tolist(), "max": values.max(0).tolist()}
    return {**count, "normalized": True} if name == "COLOR_0" else count


def _chunk(kind: bytes, content: bytes, filler: bytes) -> bytes:
    """A chunk, filled up to whole words."""
    content += filler * (-len(content) % 4)
    return struct.pack("<I4s", len(content), kind) + content
