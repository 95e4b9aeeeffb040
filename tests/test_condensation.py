"""The reduced system against SciPy, its tangent against differences of its residual, its MatPtAPs.

Run as a script under mpirun, this file compares condensed matrices of some random divisions with
products of gathered ones on rank 0, and reports the largest relative errors, how often MatPtAP has
condensed and how often PETSc had to make room.
"""

import functools
from dataclasses import replace
from unittest import mock

import numpy as np
import parallel
import pytest
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from histories import show
from hypothesis import given, settings
from hypothesis import strategies as st
from mpi4py import MPI
from petsc4py import PETSc
from runs import prepared, step
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

import rigidfx as rf
from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Step
from rigidfx.mechanics.rigid_body import Body
from rigidfx.mechanics.rotation import skew
from rigidfx.step.newton import chord

# Its residual is a polynomial of the displacement, which differences differentiate to rounding.
MATERIAL = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
SIZE = (5, 3, 3)
CELLS = pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
MASSES = pytest.mark.parametrize("mass", ["lumped", "consistent"])


@functools.cache
def _domain(cell):
    return rf.box((0, 0, 0), SIZE, SIZE, cell)


def random_boxes(rng, most=3):
    """Up to so many boxes of cells that share no node, as pairs of corners."""
    boxes = []
    for _ in range(most):
        low = rng.integers(0, SIZE)
        high = np.minimum(low + rng.integers(1, 4, size=3), SIZE)
        if all(((high < a) | (b < low)).any() for a, b in boxes):
            boxes.append((low, high))
    return boxes


def scene_with(boxes, cell, *effects, **options):
    """A block of unit cells with these boxes rigid."""
    domain = _domain(cell)
    for k, (low, high) in enumerate(boxes):
        domain = domain.with_cells(
            f"body {k}",
            lambda x, low=low, high=high: np.all(
                [x.T - low >= -1e-9, x.T - high <= 1e-9], axis=(0, 2)
            ),
        )
    bodies = [rf.Rigid(f"body {k}") for k in range(len(boxes))]
    return rf.Scene(domain, MATERIAL, [*bodies, *effects], **options)


# Matrices on rank 0 ----------------------------------------------------------------------------


def gathered(A):
    """A PETSc matrix as a SciPy one on rank 0, None elsewhere. Collective."""
    A = A.convert("aij", type(A)())
    indptr, indices, values = A.getValuesCSR()
    parts = A.comm.tompi4py().gather((np.diff(indptr), indices, values))
    shape = A.getSize()
    A.destroy()
    if parts is None:
        return None
    counts, columns, entries = (np.concatenate(p) for p in zip(*parts, strict=True))
    return csr_matrix((entries, columns, np.r_[0, np.cumsum(counts)]), shape=shape)


def nodal_map(prolongation, bodies, theta, comm):
    """Dense L and P of all owned dofs on rank 0, from the kinematics alone. Collective.

    P is the derivative, by a complex step, of the displacement of nodes that move with Δr and θ; L
    has the averaged positions, equation (5).
    """
    layout = prolongation.layout
    free, first, six = prolongation.free, prolongation.first_column, prolongation.body_columns
    row0 = comm.exscan(layout.prescribed.size) or 0
    rows = comm.allreduce(layout.prescribed.size)
    L, P = np.zeros((2, rows, prolongation.size))
    for k, dof in enumerate(layout.rows.dofs[free]):
        L[row0 + dof, first + k] = P[row0 + dof, first + k] = 1.0

    def rotation(t):
        return np.linalg.solve(np.eye(3) - skew(t) / 2, np.eye(3) + skew(t) / 2)

    for k, each in enumerate(bodies):
        body, motion = each.data, each.motion
        at = six[k, :3], six[k, 3:]
        h = 1e-30
        dR = [rotation(theta[k] + 1j * h * e).imag / h @ motion.R for e in np.eye(3)]
        R_av = (motion.R + rotation(theta[k]) @ motion.R) / 2
        for n in layout.attached[k]:
            V, row = body.offsets[n], row0 + 3 * body.nodes[n] + np.arange(3)
            L[np.ix_(row, at[0])] = P[np.ix_(row, at[0])] = np.eye(3)
            L[np.ix_(row, at[1])] = -skew(R_av @ V) / body.length
            P[np.ix_(row, at[1])] = np.stack([d @ V for d in dR], axis=1) / body.length
    return comm.reduce(L), comm.reduce(P)


def condensation_errors(scene, seed):
    """Relative errors of PᵀKP and LᵀKP, L and P, and the least singular value of P. Collective."""
    rng = np.random.default_rng(seed)
    comm = scene.comm
    errors = {}
    with prepared(scene) as run:
        system = run.stepper.system
        prolongation, part = system.prolongation, system.layout
        forces = InternalForces(scene, fem.Function(scene.space))
        bodies = Bodies.of_each(
            Body(
                body.data,
                replace(body.motion, R=Rotation.from_rotvec(rng.standard_normal(3)).as_matrix()),
            )
            for body in run.stepper.state.bodies
        )
        theta = rng.uniform(-1, 1, size=(len(bodies), 3))
        six = np.array(
            [np.r_[rng.standard_normal(3), b.length * t]
             for b, t in zip(part.bodies, theta, strict=True)]
        ).reshape(-1, 6)  # fmt: skip
        prolongation.rotate(six, Step(bodies, 0.1))
        # Any state: the stiffness is evaluated in a field that depends on positions only, so that
        # it is the same on any number of ranks.
        X = scene.space.tabulate_dof_coordinates()
        for f, a in ((forces.u0, 0.3), (forces.u1, 0.5)):
            f.x.array[:] = (0.1 * np.sin(a * X[:, [1, 2, 0]] + X)).reshape(-1)
        whole = forces.bind(part.flexible)
        K = fem_petsc.assemble_matrix(whole.interior)
        K.assemble()
        full = gathered(K)
        L, P = nodal_map(prolongation, bodies, theta, comm)
        K.destroy()
        bound = forces.bind(part.flexible, part.interior, part.interface)
        condensed = CondensedMatrix(prolongation, bound.interior, bound.interface)
        for _ in range(2):  # a second time reuses pattern and products
            condensed.assemble()
            condensed.matrix.assemble()
            condensed.finish()
        info = condensed.matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)
        errors["mallocs"], errors["not needed"] = info["mallocs"], info["nz_unneeded"]
        reduced = {"LKP": gathered(condensed.matrix)}
        condensed.destroy()
        K = part.rows.matrix(whole.interior)
        fem_petsc.assemble_matrix(K, whole.interior)
        K.assemble()
        PKP = prolongation.condense(K)
        reduced["PKP"] = gathered(PKP)
        PKP.destroy()
        K.destroy()
        trial = prolongation.trial()
        P_own = gathered(trial)
        trial.destroy()
        # L is known by what it does to vectors.
        y, d = prolongation.unknowns(), part.rows.vector()
        y.array[:] = rng.standard_normal(y.array.size)
        prescribed = np.zeros(prolongation.prescribed.size)
        prolongation.apply(y, prolongation.bodies_part(y), prescribed, d)
        y_all, d_all = (comm.gather(v.array_r.copy()) for v in (y, d))
        y.destroy()
        d.destroy()
        row0 = comm.exscan(part.prescribed.size) or 0
        rows = comm.gather(row0 + part.rows.dofs)
        if comm.rank == 0:
            for name, left in (("LKP", L), ("PKP", P)):
                wanted = left.T @ (full @ P)
                scale = np.abs(wanted).max(initial=0.0) or 1.0
                errors[name] = float(np.abs(reduced[name] - wanted).max() / scale)
            rows = np.concatenate(rows)
            moved = L[rows] @ np.concatenate(y_all)
            errors["L"] = float(np.abs(np.concatenate(d_all) - moved).max(initial=0.0))
            errors["P"] = float(np.abs(P_own - P[rows]).max())
            others = np.delete(P, rows, axis=0)
            errors["elsewhere"] = float(np.abs(others).max(initial=0.0))
            errors["asymmetry"] = float(np.abs(L - P).max())
            errors["least singular value"] = float(np.linalg.svd(P, compute_uv=False)[-1])
    return errors


def _with_support(scene_boxes, cell, rng, mass):
    """The scene, held at x1 in one, all or no components where no body touches that face."""
    touching = any(high[0] == SIZE[0] for _, high in scene_boxes)
    prescribed = [] if touching else [[], [rf.Fixed("x1", "z")], [rf.Fixed("x1")]][rng.integers(3)]
    return scene_with(scene_boxes, cell, *prescribed, mass=mass)


@CELLS
@settings(max_examples=12)
@given(seed=st.integers(0, 2**20))
def test_condensed_matrices_are_the_products(cell, seed):
    """PᵀKP, LᵀKP against SciPy; L and P against kinematics; P has full rank."""
    rng = np.random.default_rng(seed)
    boxes = random_boxes(rng)
    scene = _with_support(boxes, cell, rng, "lumped")
    e = condensation_errors(scene, seed)
    if boxes and max(np.prod(high - low) for low, high in boxes) == np.prod(SIZE):
        return
    assert e["L"] <= 1e-13
    assert e["P"] <= 1e-13
    assert e["elsewhere"] == 0.0
    assert e["PKP"] <= 1e-13, e
    assert e["LKP"] <= 1e-13, e
    assert e["least singular value"] > 0.1, e
    assert e["asymmetry"] > 0.1, e  # or the two products would be the same
    assert e["mallocs"] == 0, e  # rows are known to be long enough beforehand ...
    assert boxes or e["not needed"] == 0, e  # ... and no longer


# The whole tangent -----------------------------------------------------------------------------


def _vector(prolongation, values):
    y = prolongation.unknowns()
    y.array[:] = values
    return y


def tangent_error(scene, seed, size, dt=0.3, test_side="L"):
    """Largest difference between tangent and central differences of R, relative to the tangent.

    Rotations of bodies have a size |θ| in a random iterate; the test side is L as it has to be, or
    P.
    """
    rng = np.random.default_rng(seed)
    with prepared(scene, dt) as run:
        for _ in range(2):  # into a state with strains, velocities and rotations
            step(run, dt)
        system = run.stepper.system
        eq = system
        system.solve(run.stepper.state, dt)
        prolongation = eq.prolongation
        free = prolongation.free.size
        y0 = system.newton.unknowns.array_r.copy()
        y0[:free] += 0.05 * rng.standard_normal(free)
        for k, body in enumerate(prolongation.layout.bodies):
            theta = rng.standard_normal(3)
            theta *= size / np.linalg.norm(theta)
            at = free + 6 * k
            y0[at : at + 6] = np.r_[0.2 * rng.standard_normal(3), body.length * theta]
        y, r = _vector(prolongation, y0), prolongation.unknowns()

        def residual(values):
            y.array[:] = values
            eq.residual(y, r)
            return r.array_r.copy()

        residual(y0)
        if test_side == "P":
            prolongation.increments.L = prolongation.increments.P
        eq.tangent()
        A = gathered(eq.tangent_matrix).toarray()
        h = 2e-3
        numeric = np.empty_like(A)
        for j in range(y0.size):
            e = np.zeros(y0.size)
            e[j] = h
            numeric[:, j] = (
                8 * (residual(y0 + e) - residual(y0 - e))
                - (residual(y0 + 2 * e) - residual(y0 - 2 * e))
            ) / (12 * h)
        y.destroy()
        r.destroy()
        return np.abs(A - numeric).max() / np.abs(numeric).max()


ONE = [(np.array([0, 0, 0]), np.array([2, 3, 3]))]
TWO = [
    (np.array([0, 0, 0]), np.array([2, 2, 3])),
    (np.array([3, 1, 1]), np.array([5, 3, 3])),
]
PUSHES = (
    rf.InitialVelocity(linear=(0.3, 0.0, 0.1), angular=(0.3, 0.5, -0.4)),
    rf.Gravity((0.3, -0.2, 0.5)),
    rf.Traction("x0", (1.0, 2.0, -1.0)),
    rf.NodalForce("y0", (3.0, 5.0, -2.0)),
    rf.Resultant("body 0", force=(2.0, 1.0, 0.0), torque=(5.0, -4.0, 3.0)),
)


@MASSES
@pytest.mark.parametrize("bodies", [ONE, TWO], ids=["one body", "two bodies"])
@pytest.mark.parametrize("size", [0.05, 1.0])
def test_tangent_is_the_derivative_of_the_residual(mass, bodies, size):
    """With loads and torques on bodies; fourth-order differences leave h⁴ = 2e-11 and rounding."""
    scene = scene_with(bodies, "tetrahedron" if mass == "lumped" else "hexahedron", *PUSHES,
                       mass=mass)  # fmt: skip
    error = tangent_error(scene, seed=1, size=size)
    show(error=error)
    assert error <= 1e-9


def test_tangent_with_supports():
    """Dofs that are held in one component only are dropped, the rest is in its place."""
    moved = rf.PrescribedMotion("x1", "xz", displacement=lambda t: (0.02 * t, 0.0, 0.01 * t))
    scene = scene_with(ONE, "hexahedron", *PUSHES[1:], moved, mass="consistent")
    assert tangent_error(scene, seed=2, size=0.7) <= 1e-9


def test_tangent_of_a_body_alone():
    """All cells rigid, under loads: 6 × 6."""
    effects = [rf.Rigid(), *PUSHES[:-1], rf.Resultant(None, torque=(50.0, -40.0, 30.0))]
    scene = rf.Scene(_domain("hexahedron"), MATERIAL, effects)
    assert tangent_error(scene, seed=3, size=1.0) <= 1e-9


def test_with_another_test_side_the_tangent_is_another():
    """The measure of the tests above can fail."""
    scene = scene_with(ONE, "hexahedron", *PUSHES)
    assert tangent_error(scene, seed=1, size=0.5, test_side="P") > 1e-3


# How often PETSc condenses ---------------------------------------------------------------------

PRODUCTS = "MatPtAPNumeric", "MatPtAPSymbolic", "MatMatMultNum", "MatTrnMatMultNum"


def products_in_steps(scene, steps=3, dt=0.1):
    """How often PETSc has multiplied matrices, by event, and tangents assembled. Collective."""
    PETSc.Log.begin()
    with mock.patch.object(chord, "DEAR", np.inf), prepared(scene, dt) as run:  # none is kept

        def counts():
            return [PETSc.Log.Event(name).getPerfInfo()["count"] for name in PRODUCTS]

        step(run, dt)  # a consistent mass is condensed in the first step
        before, tangents = counts(), 0
        for _ in range(steps):
            tangents += step(run, dt).solution.tangents
        made = {name: b - a for name, a, b in zip(PRODUCTS, before, counts(), strict=True)}
    return made, tangents


# On several ranks ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def on_ranks():
    """Errors of all seeds by the number of ranks."""
    return {n: parallel.run(__file__, n, timeout=600) for n in (2,)}


@pytest.mark.parallel
def test_condensed_matrices_on_several_ranks(on_ranks):
    """Gathered on rank 0, compared there by SciPy."""
    found = on_ranks[2]
    assert found["ranks"] == 2
    for e in found["errors"]:
        assert max(e["L"], e["P"]) <= 1e-13, e
        assert max(e["PKP"], e["LKP"]) <= 1e-13, e
        assert e["least singular value"] > 0.1, e
        assert e["mallocs"] == 0, e
    assert found["spans"] > 0  # bodies across ranks
    for made, tangents in found["products"]:  # of each rank
        assert tangents >= 6
        assert made["MatPtAPNumeric"] == tangents
        assert sum(made.values()) == tangents


def main():
    """Some divisions on the ranks that there are."""
    comm = MPI.COMM_WORLD
    errors, spans = [], 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        cell = ("hexahedron", "tetrahedron")[seed % 2]
        scene = _with_support(random_boxes(rng), cell, rng, "lumped")
        errors.append(condensation_errors(scene, seed))
        with prepared(scene) as run:
            for body in run.stepper.state.bodies.of.records:
                holders = comm.allgather(body.nodes.size > 0)
                spans += sum(holders) == comm.size
    products = comm.gather(products_in_steps(scene_with(TWO, "hexahedron", *PUSHES)))
    if comm.rank == 0:
        found = {"ranks": comm.size, "errors": errors, "spans": spans, "products": products}
        parallel.report(found)


if __name__ == "__main__":
    main()
