"""Sets of edges: lines of nodes in second order, from markers, curves of gmsh and input files.

Run as a script under mpirun, this file reports histories of a bar that is loaded along its edges.
"""

import sys
from contextlib import closing

import numpy as np
import pytest
from cad import saved
from mpi4py import MPI
from parallel import on_1_and_3_ranks
from parallel import report as tell
from parallel import run as mpirun

import rigidfx as rf
from rigidfx.base.errors import RigidfxWarning, SceneError

COMM = MPI.COMM_WORLD
STEEL = rf.StVenantKirchhoff(E=200e9, nu=0.3, rho=8000.0)
SOFT = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
alone = pytest.mark.skipif(COMM.size > 1, reason="writes files")


def nodes(scene, name):
    """Number of nodes of a set, on all ranks together."""
    return scene.sum(np.count_nonzero(scene.nodes(name, "test") < scene.owned_nodes))


def square(side, tol=1e-9):
    """A marker of the rim of a square at z = 0."""
    return lambda x: (x[2] < tol) & (np.abs(x[:2] - side / 2).max(axis=0) > side / 2 - tol)


# A simply supported solid plate of 10 m × 10 m × 1 m, NAFEMS's FV52 [Hz]: second-order cells of 20
# nodes have 44.76, 110.5, 169.1, these of 27 nodes, which are softer, as follows.
FV52 = {4: (44.67, 110.0, 110.0, 166.2), 8: (43.96, 106.35, 106.35, 160.1)}


@pytest.mark.parametrize("n", FV52)
def test_plate_on_its_rim(n):
    plate = rf.box((0, 0, 0), (10, 10, 1), (n, n, 1)).with_edges("rim", square(10))
    scene = rf.Scene(plate, STEEL, [rf.Fixed("rim", "z")], order=2, mass="consistent")
    assert nodes(scene, "rim") == 8 * n
    found = rf.modes(scene, 4).frequencies[:4]
    np.testing.assert_allclose(found, FV52[n], rtol=5e-4)


def test_vertices_are_every_other_node():
    """A warning tells of it, in second order and for effects that name the set."""
    plate = rf.box((0, 0, 0), (10, 10, 1), (4, 4, 1)).with_vertices("rim", square(10))
    held = [rf.Fixed("rim", "z")]
    with pytest.warns(RigidfxWarning, match=r"Fixed on 'rim' acts on .* both ends of 16 edges"):
        scene = rf.Scene(plate, STEEL, held, order=2)
    assert nodes(scene, "rim") == 16
    rf.Scene(plate, STEEL, order=2)
    rf.Scene(plate, STEEL, held, element="enhanced")
    apart = plate.with_vertices("corners", lambda x: np.abs(x[:2] - 5).min(axis=0) > 5 - 1e-9)
    apart = apart.with_edges("rim", square(10))  # comes before vertices of the same name
    rf.Scene(apart, STEEL, [*held, rf.Spring("rim", 1.0)], order=2)
    with pytest.warns(RigidfxWarning, match=r"PointMass.* both ends of 4 edges"):
        rf.Scene(apart, STEEL, [rf.PointMass("corners", 1.0)], order=2)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_edges_have_their_middle_in_the_marker(cell):
    """Across a strip of one cell, or a corner, an edge has both ends on the rim."""
    strip = rf.box((0, 0, 0), (4, 4, 1), (1, 4, 1), cell).with_edges("rim", square(4))
    assert strip.count(strip.find("rim", (1,), "test")) == 10
    with pytest.raises(SceneError, match="true for no edges"):
        strip.with_edges("none", lambda x: x[0] > 9)
    with pytest.raises(SceneError, match="both ends of 1 edges and for the middle of none"):
        strip.with_edges("far", lambda x: (np.abs(x[0] - 2) > 1) & (x[2] < 0.1) & (x[1] == 2.0))
    with pytest.warns(RigidfxWarning, match="true for 2 vertices at which no edge of the set ends"):
        strip.with_edges(
            "some", lambda x: (x[2] < 0.1) & ((x[1] < 0.1) | (x[1] == 2.0) & (x[0] != 2))
        )


def test_springs_masses_and_forces_on_edges():
    """A rigid cube on a spring along its rim: ω² = k/(m + M), and it sinks by F/k."""
    k, M, F = 5e3, 4.0, 30.0
    cube = rf.box((0, 0, 0), (1, 1, 1), (2, 2, 2)).with_edges("rim", square(1))
    scene = [rf.Spring("rim", k), rf.PointMass("rim", M), rf.NodalForce("rim", (0, 0, -F))]
    stiff = rf.StVenantKirchhoff(E=1e9, nu=0.3, rho=10.0)
    scene = rf.Scene(cube, stiff, scene, order=2, probes={"top": (1, 1, 1)})
    assert nodes(scene, "rim") == 16
    squares = rf.modes(scene, 6).squares
    assert np.abs(squares / (k / (10.0 + M)) - 1).min() < 1e-5
    *_, last = rf.static(scene, 1)
    np.testing.assert_allclose(last.probes["top"], (0, 0, -F / k), rtol=0, atol=1e-9 * F / k)


# Files ------------------------------------------------------------------------------------------

CORNERS = [(0, 0), (6, 0), (6, 6), (0, 6)]


def write_loop(path, version=4.1, order=1):
    """A slab whose lower rim is four curves of six elements each, and a curve beside it."""

    def build(model):
        slab = model.occ.addBox(0, 0, 0, 6, 6, 1)
        beside = model.occ.addLine(model.occ.addPoint(9, 0, 0), model.occ.addPoint(9, 6, 0))
        model.occ.synchronize()
        model.addPhysicalGroup(3, [slab], 1, name="slab")
        curves = []
        for k, (a, b) in enumerate(zip(CORNERS, CORNERS[1:] + CORNERS[:1], strict=True), start=2):
            low, high = np.minimum(a, b) - 0.1, np.maximum(a, b) + 0.1
            ((_, curve),) = model.getEntitiesInBoundingBox(*low, -0.1, *high, 0.1, dim=1)
            curves.append(curve)
            model.addPhysicalGroup(1, [curve], k, name=f"side {k}")
        if version > 4:
            model.addPhysicalGroup(1, [*curves, beside], 7, name="rim")
        for _, curve in model.getEntities(1):
            model.mesh.setTransfiniteCurve(curve, 7)
        model.mesh.generate(3)
        model.mesh.setOrder(order)

    return saved(path, build, MshFileVersion=version)


@alone
@pytest.mark.parametrize(("version", "order"), [(1, 1), (2.2, 1), (2.2, 2), (4.1, 2)])
@pytest.mark.filterwarnings("ignore:.*do not have all edges")
def test_curves_share_nodes(tmp_path, version, order):
    """Each of four curves has its seven nodes, and those between in second order."""
    domain = rf.read_msh(write_loop(tmp_path / "loop.msh", version, order))
    scene = rf.Scene(domain, SOFT, order=order, mass="consistent")
    names = sorted(name for name, dim in domain.sets if dim == 1 and name != "rim")
    assert [nodes(scene, name) for name in names] == [6 * order + 1] * 4


@alone
def test_curves_beside_the_cells(tmp_path):
    path = write_loop(tmp_path / "loop.msh")
    with pytest.warns(
        RigidfxWarning, match=r"do not have all edges .* 'rim' \(6 of 30 edges\): th"
    ):
        domain = rf.read_msh(path)
    assert domain.count(domain.find("rim", (1,), "test")) == 24


# Ranks ------------------------------------------------------------------------------------------


def history():
    """Rows of a bar that is held, loaded, sprung and weighted along edges; its nodes by rank."""
    bar = rf.box((0, 0, 0), (6, 1, 1), (6, 1, 1))
    bar = bar.with_edges("lip", lambda x: (x[0] > 6 - 1e-9) & (x[2] > 1 - 1e-9))
    bar = bar.with_edges("root", lambda x: (x[0] < 1e-9) & (np.abs(x[1:] - 0.5).max(axis=0) > 0.4))
    scene = rf.Scene(
        bar,
        SOFT,
        [
            rf.Fixed("root"),
            rf.NodalForce("lip", (1.0, 2.0, -9.0), until=0.3),
            rf.Spring("lip", 20.0, damping=1.0),
            rf.PointMass("lip", 3.0),
        ],
        order=2,
        probes={"tip": (6.0, 1.0, 1.0)},
    )
    with closing(rf.simulate(scene, 0.1, 0.5, progress=False)) as reports:
        rows = [[r.energy, *r.probes["tip"], *r.linear_momentum] for r in reports]
    found = scene.nodes("lip", "test")
    return rows, COMM.allgather([found.size, int(np.sum(found < scene.owned_nodes))])


@alone
@on_1_and_3_ranks
def test_edges_on_ranks(tmp_path, ranks):
    """The same history and curves, also where a rank has no edge of a set."""
    path = write_loop(tmp_path / "loop.msh", 2.2)
    found = mpirun(__file__, ranks, 300, str(path))
    rows, by_rank = np.array(found["rows"]), np.array(found["by rank"])
    assert by_rank[:, 1].sum() == 3
    assert by_rank[:, 0].min() == (0 if ranks > 1 else 3)
    alone, _ = history()
    np.testing.assert_allclose(rows, alone, rtol=0, atol=1e-9 * np.abs(alone).max())
    assert found["sides"] == [7] * 4


if __name__ == "__main__":
    rows, by_rank = history()
    read = rf.Scene(rf.read_msh(sys.argv[1]), SOFT)
    sides = [int(nodes(read, f"side {k}")) for k in range(2, 6)]
    tell({"rows": rows, "by rank": by_rank, "sides": sides})
