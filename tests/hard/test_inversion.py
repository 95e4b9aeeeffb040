"""Cells that turn inside out are found, named, and never accepted."""

import re

import numpy as np
import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.inversion import Inversion
from rigidfx.state import State

# Supports that move at full speed from t = 0 on.
pytestmark = pytest.mark.filterwarnings("ignore:.* acts with a jolt")

CELLS = pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
ORDERS = pytest.mark.parametrize("order", [1, 2])
SVK = rf.StVenantKirchhoff(E=1e5, nu=0.3, rho=100.0)


def looked_at(cell, order, displacement, flexible=None):
    """What is found at a displacement, a function of X."""
    scene = rf.Scene(
        rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1), cell), SVK, order=order, mass="consistent"
    )
    forces = InternalForces(scene, State(scene).u)
    inversion = Inversion(scene, forces)
    cells = forces.cells()
    if flexible is not None:
        from dolfinx.mesh import compute_midpoints

        x = compute_midpoints(scene.mesh, 3, cells[1])[:, 0]
        cells = {1: cells[1][flexible(x)]}
    inversion.bind(cells)
    forces.u1.interpolate(displacement)
    forces.u1.x.scatter_forward()
    return inversion.find()


def folded(X):
    """The part beyond x = 2 is mirrored back on itself."""
    return np.array([np.where(X[0] > 2, -2 * (X[0] - 2), 0.0), 0 * X[0], 0 * X[0]])


@CELLS
@ORDERS
def test_cells_inside_out_are_found(cell, order):
    found = looked_at(cell, order, folded)
    assert found.count == (2 if cell == "hexahedron" else 12)
    assert 2 < found.place[0] < 4
    assert str(found.number) in str(found)


@CELLS
@ORDERS
def test_large_rotations_and_strains_turn_nothing_over(cell, order):
    a = 2.0  # rad

    def turned(X):
        x = [3 * X[0], 0.2 * X[1], 0.1 * X[2]]
        y = [np.cos(a) * x[0] - np.sin(a) * x[1], np.sin(a) * x[0] + np.cos(a) * x[1], x[2]]
        return np.array(y) - X

    assert looked_at(cell, order, turned) is None


def test_only_flexible_cells_are_looked_at():
    assert looked_at("hexahedron", 1, folded, flexible=lambda x: x < 2) is None
    assert looked_at("hexahedron", 1, folded, flexible=lambda x: x > 3).count == 1


def crushed(material, *effects, dt=0.05):
    """A bar that is pushed together until its cells give way."""
    push = rf.PrescribedMotion("x1", displacement=lambda t: (-3.0 * t, 0.0, 0.0))
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
    return rf.simulate(rf.Scene(domain, material, [rf.Fixed("x0"), push, *effects]), dt, 1.5)


def run_to_its_end(steps):
    """Reports of a run, and what the error says that ends it."""
    reports = []
    try:
        for report in steps:
            reports.append(report)
    except rf.InversionError as error:
        return reports, str(error)
    raise AssertionError("no error")


def test_error_names_cell_place_and_time():
    reached, message = run_to_its_end(crushed(SVK))
    t = float(re.search(r"from t = (\S+) s", message)[1])
    assert t == pytest.approx(reached[-1].t)
    x = float(re.search(r"X = \((\S+),", message)[1])
    assert x in (0.5, 1.5, 2.5, 3.5)
    assert len(set(MPI.COMM_WORLD.allgather(message))) == 1


def test_step_that_closes_in_on_its_end_is_given_up():
    """Steps are not halved for ever: none is below 1/256 of the nominal one."""
    reports, _ = run_to_its_end(crushed(SVK, dt=0.05))
    steps = [r.dt for r in reports]
    assert min(steps[1:]) >= 0.05 / 256 * (1 - 1e-9)
    assert len(steps) < 600


def test_preload_that_turns_cells_inside_out():
    load = rf.Preload([rf.Traction("x1", (-1.2e5, 0.0, 0.0))], increments=4)
    scene = rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), SVK, [rf.Fixed("x0"), load])
    with pytest.raises((rf.InversionError, rf.StepError)):
        next(rf.simulate(scene, 0.1, 1.0))
