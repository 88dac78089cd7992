"""A world whose landmarks, descriptors and cameras are known exactly: no images, no files."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.config import IndexConfig, VocabularyConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Features
from vnav.core.mapping import FrameFeatures, Landmarks
from vnav.core.voxels import Voxels
from vnav.features.sift import SPACE
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.indexing import MappedKeyframe, build
from vnav.localisation.view import View
from vnav.vocabulary import train

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)


@dataclass(frozen=True)
class Things:
    """Points (N, 3) with a patch vector (N, 3) and a descriptor (N, 128) each."""

    points: Array
    patches: Array
    descriptors: NDArray[np.uint8]

    def __add__(self, other: "Things") -> "Things":
        return Things(
            np.concatenate([self.points, other.points]),
            np.concatenate([self.patches, other.patches]),
            np.concatenate([self.descriptors, other.descriptors]),
        )

    def moved(self, shift_m: tuple[float, float, float]) -> "Things":
        """The same things elsewhere: they look alike."""
        return Things(self.points + shift_m, self.patches, self.descriptors)


def root_sift(values: Array) -> NDArray[np.uint8]:
    """Bytes of RootSIFT from non-negative histograms (N, 128)."""
    share = values / values.sum(1, keepdims=True)
    return np.clip(np.rint(512 * np.sqrt(share)), 0, 255).astype(np.uint8)


def room(rng: np.random.Generator, count: int = 900) -> Things:
    """Things on four walls, 6 x 6 x 2.5 m, about the origin."""
    along, up = rng.uniform(-3, 3, count), rng.uniform(0, 2.5, count)
    depth = 3 - rng.uniform(0, 0.5, count)  # shelves before the walls
    turn = np.pi / 2 * rng.integers(0, 4, count)
    x, y = np.cos(turn) * depth - np.sin(turn) * along, np.sin(turn) * depth + np.cos(turn) * along
    patches = rng.normal(size=(count, 3))
    patches *= rng.uniform(0.02, 0.08, (count, 1)) / np.linalg.norm(patches, axis=1, keepdims=True)
    descriptors = root_sift(rng.gamma(0.4, size=(count, 128)) + 1e-3)
    return Things(np.stack([x, y, up], 1), patches, descriptors)


def pictures(rng: np.random.Generator, count: int = 150) -> Things:
    """Things on the wall at x = 3."""
    things = room(rng, count)
    on_wall = np.column_stack(
        [np.full(count, 2.9), rng.uniform(-2, 2, count), rng.uniform(0.5, 2.3, count)]
    )
    return Things(on_wall, things.patches, things.descriptors)


def looking(position: tuple[float, float, float], heading_deg: float) -> Array:
    """``T_world_camera`` of a level camera."""
    a = np.deg2rad(heading_deg)
    forward, down = np.array([np.cos(a), np.sin(a), 0.0]), np.array([0.0, 0.0, -1.0])
    return se3.make(np.stack([np.cross(down, forward), down, forward], 1), position)


def seen(
    T_world_camera: Array,
    things: Things,
    rng: np.random.Generator,
    *,
    camera: Intrinsics = CAMERA,
    noise_px: float = 0.5,
    found: float = 0.7,
    clutter: int = 100,
) -> tuple[Features, NDArray[np.intp]]:
    """Features of a view with a share of the things found, and which they are, -1 for clutter."""
    view = View(se3.inverse(T_world_camera), camera)
    px, depth = view.project(things.points)
    inside = (depth > 0.3) & (depth < 6) & (px > 2).all(1) & (px < np.array(camera.size) - 3).all(1)
    which = np.flatnonzero(inside & (rng.random(len(px)) < found))
    tip, _ = view.project(things.points[which] + things.patches[which])
    patch = tip - px[which]
    share = (things.descriptors[which].astype(float) / 512) ** 2
    descriptors = root_sift(share * rng.uniform(0.7, 1.4, share.shape) + 2e-5)
    stray = root_sift(rng.gamma(0.4, size=(clutter, 128)) + 1e-3)
    count = len(which) + clutter
    return Features(
        np.concatenate(
            [px[which] + rng.normal(0, noise_px, (len(which), 2)), rng.random((clutter, 2)) * 470]
        ),
        np.concatenate([descriptors, stray]),
        np.ones(count),
        np.append(2 * np.linalg.norm(patch, axis=1), rng.uniform(4, 20, clutter)),
        np.append(np.arctan2(patch[:, 1], patch[:, 0]), rng.uniform(-3, 3, clutter)),
        SPACE,
    ), np.append(which, np.full(clutter, -1))


NOTHING = Voxels.filled(np.zeros((0, 3)), np.zeros(0), 0.05)


def mapped(
    things: Things, poses: list[Array], rng: np.random.Generator, voxels: Voxels = NOTHING
) -> LandmarkDatabase:
    """The database of a map that keyframes at these poses see."""
    views = [seen(T, things, rng) for T in poses]
    rows = [
        (thing, k, f)
        for k, (_, which) in enumerate(views)
        for f, thing in enumerate(which)
        if thing >= 0
    ]
    thing, keyframe, feature = np.array(sorted(rows)).T
    known, landmark = np.unique(thing, return_inverse=True)
    landmarks = Landmarks(
        things.points[known], np.full(len(known), 0.005), landmark, keyframe, feature
    )
    keyframes = [
        MappedKeyframe(
            FrameFeatures(k, features, np.full((len(features), 3), np.nan)),
            T,
            np.zeros((6, 6)),
            CAMERA,
        )
        for k, (T, (features, _)) in enumerate(zip(poses, views, strict=True))
    ]
    tree = train(np.concatenate([f.descriptors for f, _ in views]), SPACE, VocabularyConfig(), 0)
    none_retired = np.zeros(len(known), bool)
    index = build(landmarks, none_retired, keyframes, tree, voxels, IndexConfig(), rng)
    return LandmarkDatabase(index, tree)


def around(centre: tuple[float, float, float]) -> list[Array]:
    """Twelve poses that look about in a room."""
    x, y, z = centre
    return [
        looking((x + 0.3 * np.cos(a), y + 0.3 * np.sin(a), z + 1.2), np.rad2deg(a))
        for a in np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ]


@dataclass(frozen=True)
class World:
    """A room, its database, and what its tools are."""

    things: Things
    database: LandmarkDatabase
    camera: Intrinsics
    looking: Callable[..., Array]
    seen: Callable[..., tuple[Features, NDArray[np.intp]]]


@pytest.fixture(scope="session")
def world() -> World:
    """One room, mapped."""
    rng = np.random.default_rng(1)
    things = room(rng)
    return World(things, mapped(things, around((0, 0, 0)), rng), CAMERA, looking, seen)


@pytest.fixture(scope="session")
def twin_world() -> World:
    """Two rooms that look the same, 20 m apart, both mapped."""
    rng = np.random.default_rng(2)
    one = room(rng, 600)
    things = one + one.moved((20, 0, 0))
    poses = around((0, 0, 0)) + around((20, 0, 0))
    return World(things, mapped(things, poses, rng), CAMERA, looking, seen)


@pytest.fixture(scope="session")
def furnished_twins() -> World:
    """Two rooms, 20 m apart, that look the same but for what hangs on the wall at x = 3."""
    rng = np.random.default_rng(4)
    one, own, other = room(rng, 600), pictures(rng), pictures(rng).moved((20, 0, 0))
    things = one + one.moved((20, 0, 0)) + own + other
    poses = around((0, 0, 0)) + around((20, 0, 0))
    return World(things, mapped(things, poses, rng), CAMERA, looking, seen)


@pytest.fixture(scope="session", params=[0.3, 0.6])
def step_m(request: pytest.FixtureRequest) -> float:
    """How far apart the two copies of a pattern are: 50 and 100 pixels in a photo from 3 m."""
    step: float = request.param
    return step


@pytest.fixture(scope="session")
def tiled_world(step_m: float) -> World:
    """A wall with a pattern of 30 things, the same again a step beside it, and 25 things more."""
    rng = np.random.default_rng(8)
    pattern, others = pictures(rng, 30), pictures(rng, 25)
    things = pattern + pattern.moved((0.0, step_m, 0.0)) + others
    poses = [looking((0.2 * k, 0.1 * k - 0.2, 1.3), 3.0 * k - 6) for k in range(5)]
    return World(things, mapped(things, poses, rng), CAMERA, looking, seen)


PERIOD_M = 0.8  # of the shelf in `shelf_world`


@dataclass(frozen=True)
class Shop(World):
    """A shelf whose boards hold the same, each a period from the last, and a cart before it."""

    shelf: Things
    cart: Things
    period_m: float


@pytest.fixture(scope="session")
def shelf_world() -> Shop:
    """A shelf of 10 boards, 8 m long, a cart before it, and a wall beside it; seen from 3 m."""
    rng = np.random.default_rng(9)
    board, cart, wall = pictures(rng, 50), pictures(rng, 50), pictures(rng, 300)
    for things in (board, cart):
        things.points[:, 1] *= PERIOD_M / 4  # pictures are spread over 4 m
    shelf = board.moved((0.0, -5 * PERIOD_M, 0.0))
    for k in range(-4, 5):
        shelf = shelf + board.moved((0.0, k * PERIOD_M, 0.0))
    things = shelf + cart + wall.moved((0.0, 6.0, 0.0))
    poses = [looking((0.0, 0.4 * k, 1.3), 0.0) for k in range(-6, 17)]
    return Shop(things, mapped(things, poses, rng), CAMERA, looking, seen, shelf, cart, PERIOD_M)


@pytest.fixture(scope="session")
def other_room() -> Things:
    """A room that is on no map."""
    return room(np.random.default_rng(3))
