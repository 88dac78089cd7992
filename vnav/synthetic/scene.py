"""A scene: boxes with textured faces, rendered to colour and depth."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.core.camera import Intrinsics
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, Grid
from vnav.core.se3 import exp_so3
from vnav.synthetic.raycast import Rectangles, Textures, color_of, depth_of, nearest_of, pyramids
from vnav.synthetic.textures import MATERIALS, texture

TEXEL_M = 0.004
SMALL_TEXEL_M = 0.0025  # on faces below a square metre
LIGHT = np.array([0.30, 0.45, 0.84])  # where light comes from, most of it
FACES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)


@dataclass(frozen=True)
class Box:
    """A box that stands upright, turned about z; in its own frame it faces along +x.

    ``centre`` and ``size`` in metres, size in the box's own frame; ``front`` is the material of
    the face it faces with, the same as the others if empty. Boxes with the same ``twin``, not
    empty, look the same in every detail.
    """

    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    yaw_rad: float
    material: str
    front: str = ""
    twin: str = ""

    @property
    def R_world_box(self) -> NDArray[np.float64]:
        """Rotation (3, 3) of the box's own frame into the world."""
        return exp_so3([0, 0, self.yaw_rad])


@dataclass(frozen=True)
class Face:
    """One face of a box: U points right, V down for who looks at it; ``normal`` at them.

    ``piece`` is the number of the piece of furniture it belongs to; ``twin`` names its look, where
    it shares that with faces of other boxes.
    """

    corner: NDArray[np.float64]
    u_edge: NDArray[np.float64]
    v_edge: NDArray[np.float64]
    normal: NDArray[np.float64]
    material: str
    piece: int
    twin: str

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height."""
        return float(np.linalg.norm(self.u_edge)), float(np.linalg.norm(self.v_edge))


@dataclass(frozen=True)
class Scene:
    """A place with its floor at z = 0, and a tour through it.

    Parameters
    ----------
    pieces
        Everything in it, walls and floors too; the boxes of a piece share their colours.
    bounds
        x0, y0, x1, y1, z1 in metres; faces that only somebody outside could see are left out.
    tour
        (N, 3) x, y in metres and yaw in radians (0 along +x, not wrapped) of a closed walk; the
        first row follows on the last. (N, 4) with the height of the floor where there are several.
    seed
        Of the textures; each face has its own pattern, also among equal boxes, unless twins.
    """

    pieces: tuple[tuple[Box, ...], ...]
    bounds: tuple[float, float, float, float, float]
    tour: tuple[tuple[float, ...], ...]
    seed: int

    def at(self, t_s: float) -> "Scene":
        """The scene at a time: itself, since nothing moves in it."""
        return self

    def render(
        self, intrinsics: Intrinsics, T_world_camera: ArrayLike
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Colour (H, W, 3) RGB and exact depth (H, W) in metres, 0 where there is nothing."""
        T = np.asarray(T_world_camera, float)
        return self.render_color(intrinsics, T), self.render_depth(intrinsics, T)

    def render_color(self, intrinsics: Intrinsics, T_world_camera: ArrayLike) -> NDArray[np.uint8]:
        """Colour (H, W, 3) RGB, black where there is nothing."""
        T = np.asarray(T_world_camera, float)
        return color_of(self.rectangles, self.textures, intrinsics, T)

    def render_depth(
        self, intrinsics: Intrinsics, T_world_camera: ArrayLike
    ) -> NDArray[np.float32]:
        """Exact depth (H, W) in metres at the pixel centres, 0 where there is nothing."""
        return depth_of(self.rectangles, intrinsics, np.asarray(T_world_camera, float))

    def has_unique_look(
        self, intrinsics: Intrinsics, T_world_camera: ArrayLike
    ) -> NDArray[np.bool_]:
        """Which pixels (H, W) see a face that is neither bare nor the twin of another."""
        unique = [not face.twin and face.material != "bare" for face in self.faces]
        nearest = nearest_of(self.rectangles, intrinsics, np.asarray(T_world_camera, float))
        return np.append(unique, False)[nearest]

    @cached_property
    def faces(self) -> tuple[Face, ...]:
        """Every face that can be seen from inside."""
        low, high = np.array([*self.bounds[:2], 0]), np.array(self.bounds[2:])
        faces = [
            f for k, piece in enumerate(self.pieces) for box in piece for f in faces_of(box, k)
        ]
        middles = [f.corner + (f.u_edge + f.v_edge) / 2 + 1e-3 * f.normal for f in faces]
        inside = [bool(((m > low) & (m < high)).all()) for m in middles]
        return tuple(face for face, keep in zip(faces, inside, strict=True) if keep)

    @cached_property
    def rectangles(self) -> Rectangles:
        """The faces as the ray caster takes them."""
        return rectangles_of(self.faces)

    @cached_property
    def textures(self) -> Textures:
        """The faces' textures, lit; made when first asked for."""
        with ThreadPoolExecutor() as pool:
            return pyramids(list(pool.map(self._texture, range(len(self.faces)))))

    def grid(self, resolution_m: float, low_m: float, high_m: float) -> Grid:
        """What stands anywhere between two heights; free elsewhere, unknown outside the bounds."""
        x0, y0, x1, y1, _ = self.bounds
        margin = 4 * resolution_m
        origin = x0 - margin, y0 - margin
        shape = [int(np.ceil((b - a + 2 * margin) / resolution_m)) for a, b in ((y0, y1), (x0, x1))]
        empty = Grid(origin, resolution_m, np.full(shape, UNKNOWN, np.uint8))
        xy = empty.centres_of(np.moveaxis(np.indices(shape), 0, -1))
        inside = ((xy > (x0, y0)) & (xy < (x1, y1))).all(-1)
        cells = np.where(inside, FREE, UNKNOWN).astype(np.uint8)
        for box in (box for piece in self.pieces for box in piece):
            bottom, top = box.centre[2] - box.size[2] / 2, box.centre[2] + box.size[2] / 2
            if bottom < high_m and top > low_m:
                own = np.abs((xy - box.centre[:2]) @ box.R_world_box[:2, :2])
                cells[(own <= np.array(box.size[:2]) / 2 + resolution_m / 2).all(-1)] = OCCUPIED
        return Grid(origin, resolution_m, cells)

    def _texture(self, index: int) -> NDArray[np.uint8]:
        face = self.faces[index]
        look = face.twin.encode()
        colors = np.random.default_rng(
            [self.seed, 2, *look] if look else [self.seed, 0, face.piece]
        )
        rng = np.random.default_rng([self.seed, 3, *look] if look else [self.seed, 1, index])
        texel_m = TEXEL_M if face.size_m[0] * face.size_m[1] > 1 else SMALL_TEXEL_M
        image = texture(MATERIALS[face.material], face.size_m, texel_m, colors, rng)
        light = 0.80 + 0.20 * float(face.normal @ LIGHT)
        return np.asarray(np.clip(image * light, 0, 255), np.uint8)


def rectangles_of(faces: Sequence[Face]) -> Rectangles:
    """The faces as the ray caster takes them."""
    return Rectangles(
        np.array([f.corner for f in faces]),
        np.array([f.u_edge for f in faces]),
        np.array([f.v_edge for f in faces]),
    )


def faces_of(box: Box, piece: int) -> list[Face]:
    """The six faces of a box of that piece."""
    faces = []
    half = np.array(box.size) / 2
    for side, outward in enumerate(FACES):
        up = np.array([0.0, 0, 1]) if outward[2] == 0 else np.array([0.0, 1, 0])
        right = np.cross(up, outward)
        corner = half * (outward - right + up)
        u_edge, v_edge = 2 * half * right, -2 * half * up
        R = box.R_world_box
        material = box.front if outward[0] == 1 and box.front else box.material
        axes = (box.centre + R @ corner, R @ u_edge, R @ v_edge, R @ outward)
        twin = f"{box.twin} {side}" if box.twin else ""
        faces.append(Face(*axes, material, piece, twin))
    return faces


def placed(boxes: Iterable[Box], x: float, y: float, yaw_deg: float) -> tuple[Box, ...]:
    """Boxes of a piece of furniture (own frame: floor at z = 0, facing +x), put into the world."""
    yaw = float(np.deg2rad(yaw_deg))
    cos, sin = np.cos(yaw), np.sin(yaw)
    return tuple(
        replace(
            box,
            centre=(
                float(x + cos * box.centre[0] - sin * box.centre[1]),
                float(y + sin * box.centre[0] + cos * box.centre[1]),
                box.centre[2],
            ),
            yaw_rad=box.yaw_rad + yaw,
        )
        for box in boxes
    )


def twins(name: str, pieces: Iterable[Iterable[Box]]) -> list[tuple[Box, ...]]:
    """The pieces as twins of all that are made with the same name, from the same boxes in order."""
    return [
        tuple(replace(box, twin=f"{name} {k} {n}") for n, box in enumerate(piece))
        for k, piece in enumerate(pieces)
    ]


def unlike(make: Callable[[int], Scene]) -> Callable[[int], Scene]:
    """Makes the same scenes without twins: every face has a look of its own."""

    def scene(seed: int) -> Scene:
        original = make(seed)
        pieces = tuple(tuple(replace(box, twin="") for box in piece) for piece in original.pieces)
        return replace(original, pieces=pieces)

    return scene


def closed_tour(*stops: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    """A scene's tour from x, y in metres and yaw in degrees; with a floor's height, where given."""
    return tuple((x, y, float(np.deg2rad(yaw_deg)), *floor) for x, y, yaw_deg, *floor in stops)
