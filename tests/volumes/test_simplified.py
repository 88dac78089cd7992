"""A mesh of fewer vertices has the same surface."""

import numpy as np

from vnav.core.point_cloud import Mesh
from vnav.volumes.simplified import simplified


def wall(side: int) -> Mesh:
    """A square of 1 m at z = 2, seen from above; red grows along x."""
    x, y = (a.ravel() for a in np.meshgrid(*2 * [np.linspace(0, 1, side)], indexing="ij"))
    vertices = np.stack([x, y, np.full(side**2, 2.0)], 1)
    first = np.arange(side**2).reshape(side, side)[:-1, :-1].ravel()
    lower = np.stack([first, first + side, first + side + 1], 1)
    upper = np.stack([first, first + side + 1, first + 1], 1)
    colors = np.stack([np.rint(255 * x), 0 * x, 0 * x], 1)
    return Mesh(vertices, np.tile([0, 0, 1], (side**2, 1)), colors, np.vstack([lower, upper]))


def test_a_wall_of_fewer_vertices_is_the_same_wall() -> None:
    found = simplified(wall(100), 400)
    corners = found.vertices_world[found.triangles].astype(float)
    doubled_area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert 200 < len(found.vertices_world) <= 400
    np.testing.assert_allclose(found.vertices_world[:, 2], 2, atol=1e-6)
    assert (doubled_area[:, 2] > 0).all()  # seen from above, as before
    np.testing.assert_allclose(found.normals_world @ [0, 0, 1], 1, atol=1e-6)
    # a cell of 5 to 6 cm has its mean half a cell from each border
    assert 0.85 < doubled_area[:, 2].sum() / 2 <= 1
    # colours are rounded once before the mean and once behind it
    np.testing.assert_allclose(found.colors[:, 0], 255 * found.vertices_world[:, 0], atol=1.01)


def test_a_small_mesh_is_kept_as_it_is() -> None:
    mesh = wall(10)
    assert simplified(mesh, 100) is mesh


def test_the_same_mesh_is_simplified_to_the_same_bytes() -> None:
    one, two = (simplified(wall(60), 300) for _ in range(2))
    assert all(getattr(one, name).tobytes() == getattr(two, name).tobytes() for name in vars(one))
