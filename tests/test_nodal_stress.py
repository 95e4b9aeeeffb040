"""Stress and strain at nodes, probes and integration points: closed forms, peaks, interfaces."""

import sys

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI
from parallel import run as mpirun
from test_output import cell_data, grid_points, point_data, read_series

import rigidfx as rf
from rigidfx.flexible.nodal_stress import NodalStress, material_groups
from rigidfx.flexible.stress import tensors, von_mises

STEEL = rf.StVenantKirchhoff(E=1e7, nu=0.3, rho=1.0)
SOFT = rf.NeoHooke(E=1e5, nu=0.2, rho=1.0)
EPS = np.finfo(np.float64).eps


def static(domain, material, effects, load, order, probes):
    """The first report of a scene that starts in static equilibrium."""
    preload = rf.Preload([load])
    scene = rf.Scene(
        domain, material, [*effects, preload], order=order, mass="consistent", probes=probes
    )
    return next(rf.simulate(scene, 1.0, 1.0, progress=False))


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_bending_peak_of_a_cantilever(cell):
    """Within 3 % of beam theory with two second-order cells over the height; the mean is half."""
    across = 1 if cell == "hexahedron" else 2
    bar = rf.box((0, 0, 0), (10, 1, 1), (10, across, 2), cell)
    probes = {str(x): (x, 0.5, z) for x, z in ((1.0, 1.0), (2.0, 1.0), (5.0, 1.0), (3.0, 0.0))}
    report = static(bar, STEEL, [rf.Fixed("x0")], rf.Traction("x1", (0, 0, -1.0)), 2, probes)
    for name, (x, _, z) in probes.items():
        at, peak = report.stresses[name], 6 * (10 - x) * (2 * z - 1)
        assert at.stress[0, 0] == pytest.approx(peak, rel=0.03)
        assert at.strain[0, 0] == pytest.approx(peak / 1e7, rel=0.04)
        if x > 1:  # nearer to the clamp the section is kept from growing thinner
            assert at.von_mises == pytest.approx(abs(peak), rel=0.05)
        assert at.von_mises == von_mises(at.stress)


def test_hole_in_a_plate():
    """Kirsch's factor 3, within 5 %, by second-order tetrahedra in plane strain."""
    plate = rf.from_gmsh(quarter_plate)
    held = [rf.Fixed(f, c) for f, c in (("x0", "x"), ("y0", "y"), ("z0", "z"), ("z1", "z"))]
    probes = {"edge": (0, 1, 0.25), "far": (10, 10, 0.25)}
    report = static(plate, STEEL, held, rf.Traction("x1", (1.0, 0, 0)), 2, probes)
    assert report.stresses["edge"].stress[0, 0] == pytest.approx(3.0, rel=0.05)
    assert report.stresses["far"].stress[0, 0] == pytest.approx(1.0, rel=0.05)


def quarter_plate(gmsh):
    """A quarter of 24 m × 24 m × 0.5 m with a hole of radius 1 m."""
    occ, model, size = gmsh.model.occ, gmsh.model, 12.0
    box, cylinder = occ.addBox(0, 0, 0, size, size, 0.5), occ.addCylinder(0, 0, -1, 0, 0, 3, 1)
    occ.cut([(3, box)], [(3, cylinder)])
    occ.synchronize()
    model.addPhysicalGroup(3, [tag for _, tag in model.getEntities(3)], name="plate")
    for name, axis, place in (
        ("x0", 0, 0),
        ("y0", 1, 0),
        ("z0", 2, 0),
        ("z1", 2, 0.5),
        ("x1", 0, size),
    ):
        low, high = np.full(3, -1e-3), np.array([size, size, 0.5]) + 1e-3
        low[axis], high[axis] = place - 1e-3, place + 1e-3
        found = model.getEntitiesInBoundingBox(*low, *high, dim=2)
        model.addPhysicalGroup(2, [tag for _, tag in found], name=name)
    field = model.mesh.field
    sizes = field.add("MathEval")
    field.setString(sizes, "F", "0.3 * (1 + 2 * (sqrt(x * x + y * y) - 1))")
    field.setAsBackgroundMesh(sizes)
    for option in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
        gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
    gmsh.option.setNumber("Mesh.ElementOrder", 2)
    model.mesh.generate(3)


def two_materials(cell, order):
    domain = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1), cell)
    domain = domain.with_cells("left", lambda x: x[0] < 1.01)
    domain = domain.with_cells("right", lambda x: x[0] > 0.99)
    probes = {"left": (0.6, 0.3, 0.9), "right": (1.4, 0.2, 0.1)}
    materials = {"left": STEEL, "right": SOFT}
    return rf.Scene(domain, materials, order=order, mass="consistent", probes=probes)


@pytest.mark.parametrize(("cell", "order"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_materials_are_not_averaged_with_each_other(cell, order):
    """A node of the surface between them has the stress of each, of a homogeneous deformation."""
    scene = two_materials(cell, order)
    F = np.array([[1.1, 0.05, 0.0], [0.0, 0.95, 0.02], [-0.03, 0.0, 1.02]])
    u = fem.Function(scene.space)
    u.interpolate(lambda x: (F - np.eye(3)) @ x)
    E, J = (F.T @ F - np.eye(3)) / 2, np.linalg.det(F)
    lame = STEEL.parameters
    steel = F @ (lame["lmbda"] * np.trace(E) * np.eye(3) + 2 * lame["mu"] * E) @ F.T / J
    lame = SOFT.parameters
    soft = (lame["mu"] * (F @ F.T - np.eye(3)) + lame["lmbda"] * np.log(J) * np.eye(3)) / J
    values = NodalStress(scene).measure(u)
    X = scene.space.tabulate_dof_coordinates()
    for group, expected, own in ((0, steel, X[:, 0] < 1.01), (1, soft, X[:, 0] > 0.99)):
        given = values[group][own]
        np.testing.assert_allclose(tensors(given[:, :6]) - expected, 0, atol=1e5 * EPS * 1e7)
        np.testing.assert_allclose(tensors(given[:, 6:]) - E, 0, atol=1e3 * EPS)
        assert not values[group][~own].any()
    assert np.count_nonzero((X[:, 0] < 1.01) & (X[:, 0] > 0.99)) > 3


def test_equal_materials_are_one():
    domain = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1))
    domain = domain.with_cells("left", lambda x: x[0] < 1.01)
    domain = domain.with_cells("right", lambda x: x[0] > 0.99)
    same = rf.StVenantKirchhoff(E=1e7, nu=0.3, rho=1.0)
    scene = rf.Scene(domain, {"left": STEEL, "right": same})
    assert not material_groups(scene).any()


def swinging(folder):
    """Histories of two probes of a bar of two materials that turns, bends and is rigid in part."""
    domain = rf.box((0, 0, 0), (6, 1, 1), (6, 1, 1))
    domain = domain.with_cells("left", lambda x: x[0] < 3.01)
    domain = domain.with_cells("right", lambda x: x[0] > 2.99)
    spin = rf.InitialVelocity(angular=(0.4, 0.3, 1.5))
    probes = {"a": (1.0, 0.2, 1.0), "b": (4.5, 0.5, 0.5), "seam": (3.0, 0.5, 0.5)}
    soft = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
    stiff = rf.StVenantKirchhoff(E=2e4, nu=0.2, rho=10.0)
    scene = rf.Scene(domain, {"left": soft, "right": stiff}, [spin], probes=probes)
    nodal, worst, turned = NodalStress(scene), 0.0, {}
    with rf.Recorder(scene, folder, every=4, integration_points=True) as recorder:
        criterion = rf.StrainRate(1e9, 0.5, never="right", wake="all")
        for report in rf.simulate(scene, 0.05, 1.2, rigidify=criterion, progress=False):
            recorder.write(report)
            at = report.stresses["a"]
            if len(report.rigid):
                turned[report.t] = at.von_mises
            state = report.state
            state.rebuild()
            values = nodal.measure(state.u)[0]
            X = scene.space.tabulate_dof_coordinates()[: scene.owned_nodes]
            here = np.isclose(X, (1.0, 0.0, 1.0)).all(axis=1), np.isclose(X, 1.0).all(axis=1)
            parts = [values[: scene.owned_nodes][h].sum(axis=0) for h in here]
            expected = scene.sum(0.8 * parts[0] + 0.2 * parts[1])
            worst = max(worst, np.abs(tensors(expected[:6]) - at.stress).max())
    return worst, turned


def test_probes_read_nodal_values_also_in_bodies(tmp_path):
    """Shape functions times nodal values; in a body they turn, and von Mises' stays."""
    worst, turned = swinging(tmp_path)
    scale = max(turned.values())
    assert scale > 10.0
    assert worst < 1e3 * EPS * 1e4
    assert len(turned) > 8
    np.testing.assert_allclose([*turned.values()], scale, atol=1e3 * EPS * 1e4)
    h = rf.read_history(tmp_path / "history.csv")
    assert h["von_mises_a"][-1] == list(turned.values())[-1]
    for name in ("stress_seam_xx", "strain_b_xz", "von_mises_b"):
        assert np.ptp(h[name]) > 0


def test_integration_points_are_a_cloud(tmp_path):
    """As many as cells have, where they are now, with what is computed there."""
    swinging(tmp_path)
    grid = [*read_series(tmp_path / "points.pvd").values()][-1]
    whole = [*read_series(tmp_path / "fields.pvd").values()][-1]
    assert grid.GetNumberOfPoints() == grid.GetNumberOfCells() == 6 * 8
    inside = grid_points(grid).reshape(6, 8, 3)
    np.testing.assert_allclose(inside.mean(axis=1)[:, 1:], 0.5, atol=1e-14)
    np.testing.assert_allclose(inside.mean(axis=1)[:, 0], np.arange(6) + 0.5, atol=1e-14)
    means = point_data(grid, "stress").reshape(6, 8, 9).mean(axis=1)
    np.testing.assert_allclose(means, cell_data(whole, "cell_stress"), atol=0.02 * means.max())
    assert np.ptp(point_data(grid, "von_mises").reshape(6, 8), axis=1).min() > 0
    turned = np.ptp(point_data(grid, "displacement"), axis=0)
    assert turned[0] > 1.0
    # Where the materials meet, the body has a point of its own for either.
    assert whole.GetNumberOfPoints() == 7 * 4 + 4


@pytest.mark.parallel
def test_probes_on_several_ranks(tmp_path):
    swinging(tmp_path / "1")
    one = rf.read_history(tmp_path / "1" / "history.csv")
    mpirun(__file__, 3, 120, str(tmp_path / "3"))
    three = rf.read_history(tmp_path / "3" / "history.csv")
    for name, column in one.items():
        if name.startswith(("von_mises", "stress", "strain")):
            scale = np.abs(column).max()
            np.testing.assert_allclose(three[name], column, atol=1e-7 * scale + 1e-12, err_msg=name)


if __name__ == "__main__":
    found, _ = swinging(sys.argv[1])
    assert MPI.COMM_WORLD.allreduce(found, op=MPI.MAX) < 1e3 * EPS * 1e4
