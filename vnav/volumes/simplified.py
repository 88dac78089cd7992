"""A mesh of fewer vertices: those that lie in one cell of a lattice become one.

Source: Rossignac and Borrel 1993, by open3d. Importing open3d takes a second: import this module
where needed.
"""

import numpy as np
from open3d.geometry import TriangleMesh
from open3d.utility import Vector3dVector, Vector3iVector

from vnav.core.point_cloud import Mesh

LARGER = 1.1  # cells, where too many have a vertex


def simplified(mesh: Mesh, most: int) -> Mesh:
    """A mesh of at most so many vertices, the same bytes for the same mesh; a small one as it is.

    Vertices and colours are means over their cells.
    """
    if len(mesh.vertices_world) <= most:
        return mesh
    whole = TriangleMesh(
        Vector3dVector(mesh.vertices_world.astype(float)), Vector3iVector(mesh.triangles.copy())
    )
    whole.vertex_colors = Vector3dVector(mesh.colors / 255)
    cell_m = max(float(np.sqrt(whole.get_surface_area() / most)), 1e-6)
    found = whole.simplify_vertex_clustering(cell_m)
    while len(found.vertices) > most:
        cell_m *= LARGER
        found = whole.simplify_vertex_clustering(cell_m)
    found.compute_vertex_normals()
    return Mesh(
        np.asarray(found.vertices, np.float32),
        np.asarray(found.vertex_normals, np.float32),
        np.rint(np.asarray(found.vertex_colors) * 255).astype(np.uint8),
        np.asarray(found.triangles, np.int32),
    )
