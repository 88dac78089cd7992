"""Normal equations of cameras and landmarks, whose landmarks are eliminated first.

Source: the Schur complement of Triggs et al. 2000, "Bundle adjustment - a modern synthesis".
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from vnav.core import se3
from vnav.core.arrays import Array, Rows
from vnav.optimisation.bundle_problem import BundleProblem
from vnav.optimisation.elimination import (
    eliminate,
    less_of_cameras,
    less_of_points,
    multiply,
    project,
    put,
)
from vnav.optimisation.levels import CameraSystem, Levels
from vnav.optimisation.pose_terms import PoseTerms
from vnav.optimisation.sensor_model import Bundle

LEAST_VOLUME = 1e-12  # of a landmark's information, of that of a ball: less determines no point


class Numbering:
    """A problem's cameras and landmarks, numbered by those that occur, and who sees which.

    ``cameras`` (K,), ``landmarks`` (L,): what they are in the bundle; ``camera``, ``landmark``
    (M,): numbers of each observation; ``order`` (M,): observations by landmark, ``ends`` (L,).
    """

    def __init__(self, problem: BundleProblem) -> None:
        self.cameras, self.landmarks = problem.cameras, problem.landmarks
        self.camera = self.of_cameras(problem.seen.camera)
        self.landmark = np.searchsorted(self.landmarks, problem.seen.landmark)
        self.order = np.argsort(self.landmark, kind="stable")
        self.ends = np.cumsum(np.bincount(self.landmark, minlength=len(self.landmarks)))
        self.levels = Levels(self._linked(problem))

    def of_cameras(self, cameras: NDArray[np.integer]) -> Rows:
        """Numbers of cameras of the bundle."""
        return np.searchsorted(self.cameras, cameras)

    def _linked(self, problem: BundleProblem) -> csr_array:
        K, L = len(self.cameras), len(self.landmarks)
        sees = csr_array((np.ones(len(self.camera)), (self.camera, self.landmark)), shape=(K, L))
        ends = np.array([[e.i, e.j] for e in problem.edges], np.intp).reshape(-1, 2)
        i, j = self.of_cameras(ends).T
        edges = csr_array((np.ones(len(i)), (i, j)), shape=(K, K))
        return csr_array(sees @ sees.T + edges + edges.T)


class NormalEquations:
    """Of cameras' tangents (K, 6) and landmarks' moves (L, 3), by what M observations tell.

    ``of_camera`` (M, 3, 6), ``of_point`` (M, 3, 3): derivatives of what is observed.
    """

    def __init__(self, numbering: Numbering, of_camera: Array, of_point: Array) -> None:
        self.numbering, self._J = numbering, (of_camera, of_point)
        self._cameras = np.zeros((len(numbering.cameras), 6, 6))
        self._points = np.zeros((len(numbering.landmarks), 3, 3))
        self._across = np.zeros((len(numbering.order), 6, 3))  # by landmark
        rows = numbering.order, numbering.camera, numbering.landmark
        multiply(*rows, of_camera, of_point, self._cameras, self._points, self._across)
        self._links: list[tuple[Rows, Rows, Array]] = []

    def right(self, residuals: Array) -> tuple[Array, Array]:
        """Right sides (K, 6, R) and (L, 3, R) of what is observed (M, 3, R)."""
        of_cameras = np.zeros((len(self._cameras), 6, residuals.shape[2]))
        of_points = np.zeros((len(self._points), 3, residuals.shape[2]))
        rows = self.numbering.camera, self.numbering.landmark
        project(*rows, *self._J, residuals, of_cameras, of_points)
        return of_cameras, of_points

    def add(self, terms: PoseTerms, bundle: Bundle) -> Array:
        """Add what is known of poses; its right side (K, 6)."""
        information, right = terms.equations(bundle)
        of_cameras, linked = np.zeros((len(self._cameras), 6)), terms.i >= 0
        i, j = (self.numbering.of_cameras(cameras) for cameras in (terms.i[linked], terms.j))
        for camera, part, own in ((i, slice(6), linked), (j, slice(6, 12), slice(None))):
            np.add.at(self._cameras, camera, information[own, part, part])
            np.add.at(of_cameras, camera, right[own, part])
        across = information[linked, :6, 6:]
        self._links = [(i, j[linked], across), (j[linked], i, across.swapaxes(1, 2))]
        return of_cameras

    def shown(self, solved: tuple[Array, Array]) -> Array:
        """What tangents (K, 6, R) and moves (L, 3, R) change in what is observed: (M, 3, R)."""
        (tangents, moves), (of_camera, of_point) = solved, self._J
        of_both = of_camera @ tangents[self.numbering.camera]
        of_both += of_point @ moves[self.numbering.landmark]
        return np.asarray(of_both)

    def moved(self, bundle: Bundle, solved: tuple[Array, Array], weights: Array) -> Bundle:
        """The bundle moved by the sum of the R solutions, weighted."""
        (tangents, moves), numbering = solved, self.numbering
        poses, points = bundle.T_world_camera.copy(), bundle.points_world.copy()
        poses[numbering.cameras] = poses[numbering.cameras] @ se3.exp(tangents @ weights)
        points[numbering.landmarks] += moves @ weights
        return Bundle(poses, points)

    def reduced(self, held: Array | float, loose: float) -> "ReducedSystem":
        """Of the cameras alone; LinAlgError where it is not positive definite.

        ``held`` (K, 6) and ``loose``: information that keeps cameras and landmarks where they are.
        """
        cameras, points = self._cameras.copy(), self._points.copy()
        cameras[:, range(6), range(6)] += held
        points[:, range(3), range(3)] += loose
        numbering, inverse = self.numbering, np.asarray(np.linalg.inv(points), float)
        levels, every = numbering.levels, np.arange(len(cameras))
        values = np.zeros(levels.count)
        for i, j, blocks in ((every, every, cameras), *self._links):
            put(values, *levels.layout, i, j, blocks)
        seen_by = numbering.camera[numbering.order]
        eliminate(values, *levels.layout, seen_by, numbering.ends, self._across, inverse)
        return ReducedSystem(numbering, CameraSystem(levels, values), self._across, inverse)


@dataclass(frozen=True)
class ReducedSystem:
    """Cameras alone, and what leads from their solution to that of the landmarks."""

    numbering: Numbering
    cameras: CameraSystem
    across: Array
    inverse: Array

    def solve(self, of_cameras: Array, of_points: Array) -> tuple[Array, Array]:
        """Tangents (K, 6, R) and moves (L, 3, R) of right sides."""
        points, right, back = self.inverse @ of_points, of_cameras.copy(), of_points.copy()
        seen_by = self.numbering.camera[self.numbering.order], self.numbering.ends
        less_of_points(right, *seen_by, self.across, points)
        tangents = self.cameras.solve(right)
        less_of_cameras(back, *seen_by, self.across, tangents)
        return tangents, self.inverse @ back

    @property
    def knows_landmarks(self) -> bool:
        """Whether every landmark is determined, in all directions."""
        extent = np.trace(self.inverse, axis1=1, axis2=2) / 3
        return bool((np.linalg.det(self.inverse) >= LEAST_VOLUME * extent**3).all())
