"""Photos of a board by a known camera: each pixel's rays, distorted, met with the board."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.calibration.board import Board
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics

CAMERA = Intrinsics(640, 480, 522.0, 525.0, 324.0, 236.0, (0.12, -0.25, 0.002, -0.001, 0.0))
RAYS = 3  # along a pixel's side: their mean is what the pixel sees
PAPER, AROUND, NOISE = 0.02, 90, 2.0  # white margin in metres; grey beyond it; of 255


def photo(
    board: Board, camera: Intrinsics, T_camera_board: Array, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """A grey image (H, W) of the board, whose z points away from the camera."""
    printed, per_m = _printed(board)
    zero_px = round(PAPER * per_m) - 0.5
    px_of_board = np.array([[per_m, 0, zero_px], [0, per_m, zero_px], [0, 0, 1]])
    H = px_of_board @ np.linalg.inv(T_camera_board[:3, [0, 1, 3]])
    at = cv2.perspectiveTransform(_rays(camera), H).astype(np.float32)
    seen = cv2.remap(printed, at, None, cv2.INTER_LINEAR, borderValue=AROUND)
    mean = seen.reshape(camera.height, RAYS, camera.width, RAYS).mean((1, 3))
    dimmed = 20 + 0.8 * mean + NOISE * rng.standard_normal(mean.shape)
    return np.clip(dimmed + 0.5, 0, 255).astype(np.uint8)


@lru_cache
def _rays(camera: Intrinsics) -> Array:
    """Directions (H RAYS, W RAYS, 2) at z = 1 of several rays a pixel, distortion taken off."""
    steps = (np.arange(RAYS) - (RAYS - 1) / 2) / RAYS
    columns = (np.arange(camera.width)[:, None] + steps).ravel()
    rows = (np.arange(camera.height)[:, None] + steps).ravel()
    px = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 1, 2)
    exact = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 1e-7)
    rays = cv2.undistortPointsIter(
        px, camera.K, np.array(camera.distortion), np.eye(3), np.eye(3), exact
    )
    return rays.reshape(len(rows), len(columns), 2)


@lru_cache
def _printed(board: Board) -> tuple[NDArray[np.float32], float]:
    """The board with its white margin, finely, and pixels per metre."""
    image = board.image()
    image = np.kron(image, np.ones((2, 2), np.uint8))
    per_m = image.shape[1] / board.columns / board.square_m
    return np.pad(image, round(PAPER * per_m), constant_values=255).astype(np.float32), per_m


def pose(board: Board, tilt_deg: Sequence[float], centre_m: Sequence[float]) -> Array:
    """T_camera_board (4, 4) of a board turned about x, then y, its middle at a point."""
    about_x, about_y = np.deg2rad(tilt_deg)
    R = cv2.Rodrigues(np.array([0, about_y, 0]))[0] @ cv2.Rodrigues(np.array([about_x, 0, 0]))[0]
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = np.array(centre_m) - R @ (board.square_m / 2 * np.array([*board.size, 0]))
    return T


def poses(board: Board, count: int, seed: int = 0) -> list[Array]:
    """Places where all of the board is in the image, in all its parts, tilted to all sides."""
    rng, found = np.random.default_rng(seed), list[Array]()
    while len(found) < count:
        distance_m = board.square_m * max(board.size) * rng.uniform(1.3, 2.2)
        aside = rng.uniform(-0.5, 0.5, 2) * distance_m * (1.0, 0.75)
        T = pose(board, rng.uniform(-40, 40, 2), (*aside, distance_m))
        px = project(board, CAMERA, T)
        if ((px > 12) & (px < np.array(CAMERA.size) - 12)).all():
            found.append(T)
    return found


def project(board: Board, camera: Intrinsics, T_camera_board: Array) -> Array:
    """Where the camera sees the corners (N, 2)."""
    rotation, _ = cv2.Rodrigues(T_camera_board[:3, :3])
    distortion = np.array(camera.distortion)
    px, _ = cv2.projectPoints(board.points, rotation, T_camera_board[:3, 3], camera.K, distortion)
    return np.asarray(px)[:, 0]


def write_photos(folder: Path, board: Board, T_camera_board: Sequence[Array]) -> Path:
    """A folder with an image by `CAMERA` for each place of the board, called by its number."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, T in enumerate(T_camera_board):
        image = photo(board, CAMERA, T, np.random.default_rng(k))
        cv2.imwrite(str(folder / f"{k:02d}.png"), image)
    return folder
