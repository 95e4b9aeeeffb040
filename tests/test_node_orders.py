"""Cells of other programs as arrays: the order of their nodes is seen from where these lie."""

import numpy as np
import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.errors import SceneError

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="gives all on one rank")


def test_tetrahedra_of_ten_nodes():
    """Numbered as VTK and as gmsh do; curved edges stay where they are."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    vtk, gmsh = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)), (0, 1, 2, 3, 5, 4)
    middles = np.array([(corners[a] + corners[b]) / 2 for a, b in vtk])
    volumes = []
    for bulge in (0.0, 0.1):
        middles[0, 1] = -bulge  # of the edge from 0 to 1, outwards
        for order in (range(6), gmsh):
            points = np.vstack([corners, middles[[*order]]])
            volumes.append(volume(rf.from_arrays(points, np.arange(10)[None], "tetrahedron")))
    assert volumes[0] == pytest.approx(1 / 6, rel=1e-13)
    assert volumes[0::2] == pytest.approx(volumes[1::2], rel=1e-13)
    assert 0.01 < volumes[2] - volumes[0] < 0.1


def volume(domain):
    """By the mass of second-order cells with density 1 [m³]."""
    scene = rf.Scene(domain, rf.NeoHooke(E=1.0, nu=0.2, rho=1.0), order=2, mass="consistent")
    return scene.sum(scene.nodal_mass[: scene.owned_nodes].sum())


# A brick of Abaqus and VTK: corners round the bottom and round the top; then the edges of the
# bottom, of the top and the upright ones; in VTK the faces, x to z, and the centre.
BOTTOM = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
ROUND = np.array([*BOTTOM, *((x, y, 1.0) for x, y, _ in BOTTOM)])
RING = [(0, 1), (1, 2), (2, 3), (3, 0)]
OF_EDGES = [*RING, *((a + 4, b + 4) for a, b in RING), *((k, k + 4) for k in range(4))]
OF_FACES = [(0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7)]


def bricks(nodes):
    """Points of two bricks side by side and their cells, of so many nodes, as VTK has them."""
    parts = [*((k,) for k in range(8)), *OF_EDGES, *OF_FACES, tuple(range(8))][:nodes]
    one = np.array([ROUND[[*part]].mean(axis=0) for part in parts])
    both = np.vstack([one, one + np.array([1, 0, 0])])
    points, where = np.unique(both, axis=0, return_inverse=True)
    return points, where.reshape(2, nodes)


@pytest.mark.parametrize("nodes", [8, 27])
def test_bricks_of_other_programs(nodes):
    """Corners go round; where they are as DOLFINx has them nothing changes; curved faces stay."""
    points, cells = bricks(nodes)
    ours = cells[:, [0, 1, 3, 2, 4, 5, 7, 6, *range(8, nodes)]]
    for rows in (cells, ours, cells[:, [4, 5, 6, 7, 0, 1, 2, 3, *range(8, nodes)]]):
        assert volume(rf.from_arrays(points, rows)) == pytest.approx(2.0, rel=1e-12)
    abaqus = [*range(8), *range(nodes - 1, 7, -1)]  # others than corners in another order
    points[:, 2] *= 1 + 0.1 * points[:, 0] * (2 - points[:, 0])  # straight for those of first order
    bulged = volume(rf.from_arrays(points, cells))
    assert bulged == pytest.approx(2.0 + (0.1 * 4 / 3 if nodes == 27 else 0.1), rel=1e-12)
    assert volume(rf.from_arrays(points, cells[:, abaqus])) == pytest.approx(bulged, rel=1e-13)


def test_cells_that_are_not_taken_as_they_are():
    """What a file of another program may hold, with a remedy."""
    points, cells = bricks(20)
    for given, kind, remedy in (
        (cells, "hexahedron", r"cells\[:, :8\], and let the scene be of second order"),
        (cells[:, :6], "hexahedron", "Wedges and pyramids are no cells of a domain"),
        (cells[:, :10], "hexahedron", "another kind: cell='tetrahedron'"),
        (cells[:, :8], "tetrahedron", "another kind: cell='hexahedron'"),
        (cells[:, :3], "hexahedron", r"got int64 of shape \(2, 3\)\.$"),
    ):
        with pytest.raises(SceneError, match=remedy):
            rf.from_arrays(points, given, kind)
    assert volume(rf.from_arrays(points, cells[:, :8])) == pytest.approx(2.0, rel=1e-12)
    points, cells = bricks(27)
    with pytest.raises(SceneError, match=r"not what lies there\. Give the corners alone, cells"):
        rf.from_arrays(points, cells[:, [*range(8), *[8] * 19]])
    twisted = ROUND[[0, 2, 1, 3, 4, 5, 6, 7]]
    with pytest.raises(SceneError, match="As all cells are, their nodes may be in another order"):
        rf.from_arrays(twisted, np.arange(8)[None])
