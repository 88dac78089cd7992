"""Scenes in which somebody or something moves: where at a time, and what of a picture is whose."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.core.camera import Intrinsics
from vnav.errors import CaptureError
from vnav.synthetic.crowd import draw_strolls
from vnav.synthetic.figure import Figure, dressed
from vnav.synthetic.places import net_of
from vnav.synthetic.raycast import Rectangles, Textures, color_of, depth_of, nearest_of, pyramids
from vnav.synthetic.scene import Scene
from vnav.synthetic.sights import sight_of
from vnav.synthetic.strolls import STEP_S, Stroll, schedule

Array = NDArray[np.float64]
VIEW_WIDTH = 80  # pixels of the images that shares are measured in
WAVE, WAVE_S = 0.4, 8.0  # the wanted share comes and goes by this much of itself
TRIES, CLOSE, ENOUGH = 6, 0.05, 0.2  # relative error of the share: done at once, at most


class Mover(Protocol):
    """Somebody or something that moves."""

    def at(self, t_s: float) -> Rectangles:
        """Its faces at a time."""

    def images(self) -> list[NDArray[np.uint8]]:
        """A texture for each of them, in their order."""

    def moves_at(self, t_s: float) -> bool:
        """Whether any of it moves."""


@dataclass(frozen=True)
class Walker:
    """Somebody and their way."""

    figure: Figure
    stroll: Stroll

    def at(self, t_s: float) -> Rectangles:
        """The body's faces at a time."""
        return self.figure.rectangles(self.stroll.at(t_s))

    def images(self) -> list[NDArray[np.uint8]]:
        """Of body and clothes."""
        return self.figure.images()

    def moves_at(self, t_s: float) -> bool:
        """Whether any of the body moves."""
        return self.stroll.moves_at(t_s)


@dataclass(frozen=True)
class Moment:
    """What stands at one time: faces, their textures and whose (S,) they are, 0 of the scene's."""

    rectangles: Rectangles
    textures: Textures
    owner: NDArray[np.uint8]

    @classmethod
    def of(cls, parts: Sequence[Rectangles], textures: Textures) -> "Moment":
        """Of the scene's faces, then each walker's."""
        owner = np.repeat(np.arange(len(parts)), [len(part.corner) for part in parts])
        return cls(Rectangles.joined(parts), textures, owner.astype(np.uint8))

    def render_color(self, intrinsics: Intrinsics, T_world_camera: ArrayLike) -> NDArray[np.uint8]:
        """Colour (H, W, 3) RGB, black where there is nothing."""
        T = np.asarray(T_world_camera, float)
        return color_of(self.rectangles, self.textures, intrinsics, T)

    def render_depth(
        self, intrinsics: Intrinsics, T_world_camera: ArrayLike
    ) -> NDArray[np.float32]:
        """Exact depth (H, W) in metres at the pixel centres, 0 where there is nothing."""
        return depth_of(self.rectangles, intrinsics, np.asarray(T_world_camera, float))

    def render_walkers(
        self, intrinsics: Intrinsics, T_world_camera: ArrayLike
    ) -> NDArray[np.uint8]:
        """Number of the walker (H, W) at the pixel centres, from 1; 0 where there is none."""
        nearest = nearest_of(self.rectangles, intrinsics, np.asarray(T_world_camera, float))
        return np.where(nearest >= 0, self.owner[nearest], 0).astype(np.uint8)


@dataclass(frozen=True)
class Peopled:
    """A scene in which walkers move, or things that are none."""

    scene: Scene
    walkers: tuple[Mover, ...]

    def at(self, t_s: float) -> Moment:
        """The scene with everybody where they are at that time."""
        everybody = (walker.at(t_s) for walker in self.walkers)
        return Moment.of([self.scene.rectangles, *everybody], self.textures)

    @property
    def tour(self) -> tuple[tuple[float, ...], ...]:
        """The scene's."""
        return self.scene.tour

    @cached_property
    def textures(self) -> Textures:
        """Of the scene's faces and of everybody's, in the order of a moment's rectangles."""
        images = [image for walker in self.walkers for image in walker.images()]
        return self.scene.textures.followed_by(pyramids(images))


def peopled(
    scene: Scene, count: int, share: float, view: Intrinsics, T_world_camera: ArrayLike, seed: int
) -> Peopled:
    """The scene with ``count`` walkers who cover that share of a camera's pixels, in the mean.

    ``T_world_camera`` (K, 4, 4): where the camera is every STEP_S from time 0 on. Every other one
    sits down at times, where there are seats. CaptureError where they cannot cover as much, or not
    as little.
    """
    T, rng = np.asarray(T_world_camera, float), np.random.default_rng([seed, 6])
    view = view.scaled(VIEW_WIDTH, round(VIEW_WIDTH * view.height / view.width))
    figures = [dressed(rng, (seed, 7, n)) for n in range(count)]
    net = net_of(scene)
    has_seats = bool(np.isfinite(net.seats).any())
    schedules = [schedule(len(T) - 1, has_seats and n % 2 == 1, rng) for n in range(count)]
    wave = 1 + WAVE * np.sin(2 * np.pi * (np.arange(len(T)) * STEP_S / WAVE_S + rng.random()))
    sights = [sight_of(scene.render_depth(view, pose), net, view, pose) for pose in T]
    found, aim = [], share
    for _ in range(TRIES):
        strolls = draw_strolls(net, sights, T[:, :2, 3], aim * wave / wave.mean(), schedules)
        people = Peopled(scene, tuple(map(Walker, figures, strolls)))
        reached = walkers_share(people, view, T)
        found.append((abs(reached / share - 1), people))
        if found[-1][0] < CLOSE:
            break
        aim *= share / max(reached, share / 3)
    error, best = min(found, key=lambda pair: pair[0])
    if error > ENOUGH:
        raise CaptureError(
            f"expected {count} walkers to cover {share:.0%} of the pixels, found that they come no"
            f" nearer than {error:.0%} of it; ask for more or fewer walkers"
        )
    return best


def walkers_share(people: Peopled, view: Intrinsics, T_world_camera: Array) -> float:
    """Share of the pixels that show a walker, the mean over poses (K, 4, 4) every STEP_S."""
    masks = [
        people.at(k * STEP_S).render_walkers(view, T) > 0 for k, T in enumerate(T_world_camera)
    ]
    return float(np.mean(masks))
