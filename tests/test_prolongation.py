"""L and P: numbers of unknowns, what maps do, and that restricting is the transpose of expanding.

Run as a script under mpirun, this file reports the errors that the ranks find.
"""

from __future__ import annotations

import numpy as np
import parallel
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from scipy.spatial.transform import Rotation
from test_dof_layout import BARS, layout_of

from rigidfx.coupling.prolongation import Prolongation
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Step
from rigidfx.mechanics.rigid_body import Body, BodyMotion

# Free dofs of each bar, and whether they come in whole nodes.
FREE = {
    "flexible": (72, True),
    "one": (36, True),
    "two": (20, False),
    "held": (24, True),
    "alone": (0, True),
    "short": (12, True),
}


class Case:
    """A prolongation in the middle of a step, with random unknowns and forces."""

    def __init__(self, name):
        scene, self.layout = layout_of(name)
        self.comm = scene.comm
        self.prolongation = p = Prolongation(self.layout, self.comm)
        own = np.random.default_rng(self.comm.rank)
        common = np.random.default_rng(100)  # what all ranks know of bodies
        bodies = self.layout.bodies
        self.bodies = Bodies.of_each(
            Body(
                b,
                BodyMotion(
                    b.origin,
                    Rotation.from_rotvec(common.standard_normal(3)).as_matrix(),
                    *np.zeros((2, 3)),
                ),
            )
            for b in bodies
        )
        self.six = common.standard_normal((len(bodies), 6))
        self.blocks = common.standard_normal((len(bodies), 6, 6))
        self.step = Step(self.bodies, 0.1)
        self.y, self.r = p.unknowns(), p.unknowns()
        self.d, self.f = self.layout.rows.vector(), self.layout.rows.vector()
        self.y.array[:] = own.standard_normal(self.y.array.size)
        self.f.array[:] = own.standard_normal(self.f.array.size)
        p.rotate(self.six, self.step)

    @property
    def imposed(self):
        return np.arange(1.0, self.prolongation.prescribed.size + 1)

    def largest(self, values):
        """Largest absolute value on any rank."""
        return self.comm.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX)


def numbers(case):
    """Every unknown has one number, and one owner."""
    p = case.prolongation
    own = p.first_column + np.arange(p.free.size)
    own = np.r_[own, p.body_columns[p.owned_bodies].reshape(-1)]
    every = np.concatenate(case.comm.allgather(own))
    owned = np.concatenate(case.comm.allgather(p.owned_bodies))
    counts = np.array([case.comm.allgather(at.size) for at in case.layout.attached])
    # the first rank among those with most of the attached nodes
    wanted = [int(np.flatnonzero(c == c.max())[0]) for c in counts]
    owners = {
        int(k): rank for rank, ks in enumerate(case.comm.allgather(p.owned_bodies)) for k in ks
    }
    low, high = case.y.getOwnershipRange()
    return {
        "in order": bool((every == np.arange(p.size)).all() and every.size == p.size),
        "owned once": sorted(owned.tolist()) == list(range(len(case.layout.bodies))),
        "owners": [owners[k] for k in range(len(wanted))] == wanted,
        "of PETSc": case.comm.allreduce(
            (low, high) == (p.first_column, low + own.size), op=MPI.LAND
        ),
        "free": case.comm.allreduce(p.free.size),
        "size": p.size,
        "nodal": p.nodal,
    }


def transposed(case):
    """The error of y · Lᵀ f = f · L y."""
    p = case.prolongation
    nothing = np.zeros(p.prescribed.size)
    p.restrict(case.f, np.zeros_like(case.six), case.r)
    p.apply(case.y, p.bodies_part(case.y), nothing, case.d)
    left, right = case.y.dot(case.r), case.f.dot(case.d)
    return abs(left - right) / (case.y.norm() * case.r.norm() + 1e-300)


def exact(case):
    """Expanding moves nodes of bodies as rigid ones, free ones by y, prescribed ones as imposed."""
    p, layout = case.prolongation, case.layout
    y = p.unknowns()
    p.collapse(case.f.array_r, case.six, y)
    p.expand(y.array_r.copy(), case.step, case.imposed, case.d)
    wanted = np.full(case.d.array.size, np.nan)
    wanted[p.free] = case.f.array_r[p.free]
    wanted[p.prescribed] = case.imposed
    for each, at, six in zip(case.bodies, layout.attached, case.six, strict=True):
        body, motion = each.data, each.motion
        theta = six[3:] / body.length
        # the Cayley vector is 2 tan(angle/2) times the axis
        turn = Rotation.from_quat(np.r_[theta / 2, 1.0]).as_matrix()
        V = body.offsets[at]
        moved = six[:3] + V @ (turn @ motion.R - motion.R).T
        rows = 3 * layout.rows.positions(body.nodes[at])[:, None] + np.arange(3)
        wanted[rows] = moved
    y.destroy()
    return case.largest(np.nan_to_num(case.d.array_r - wanted, nan=np.inf))


def moments(case):
    """Σ f and Σ V fᵀ."""
    layout, sums = case.layout, np.zeros((len(case.layout.bodies), 4, 3))
    forces = case.f.array_r.reshape(-1, 3)
    for k, (body, at) in enumerate(zip(layout.bodies, layout.attached, strict=True)):
        f = forces[layout.rows.positions(body.nodes[at])]
        sums[k] = np.r_[f.sum(axis=0)[None], body.offsets[at].T @ f]
    return case.largest(case.prolongation.moments(case.f) - case.comm.allreduce(sums))


def trial(case):
    """P times a unit vector against the derivative of d, by differences of fourth order."""
    p = case.prolongation
    y0, P = p.unknowns(), p.trial()
    p.collapse(case.f.array_r, case.six, y0)
    y, d, direction, h = y0.duplicate(), case.d.duplicate(), case.y.copy(), 1e-3
    direction.normalize()
    P.mult(direction, d)
    slope = np.zeros(d.array.size)
    for factor, weight in ((1, 8), (-1, -8), (2, -1), (-2, 1)):
        y0.copy(y)
        y.axpy(factor * h, direction)
        p.expand(y.array_r.copy(), case.step, case.imposed, case.d)
        slope += weight * case.d.array_r / (12 * h)
    error = case.largest(d.array_r - slope)
    for item in (y0, y, d, direction, P):
        item.destroy()
    p.rotate(case.six, case.step)
    return error


def at_rest(case):
    """Without a rotation L and P agree."""
    p = case.prolongation
    p.pose(case.bodies)
    P = p.trial()
    P.mult(case.y, case.f)
    p.apply(case.y, p.bodies_part(case.y), np.zeros(p.prescribed.size), case.d)
    P.destroy()
    return case.largest(case.f.array_r - case.d.array_r)


def blocks(case):
    """6×6 blocks go to the bodies' unknowns, and nowhere else."""
    p = case.prolongation
    block = 3 if p.nodal else 1
    length = np.full(p.owned // block, 6 // block, dtype=PETSc.IntType)
    C = p.empty_matrix((length, 0 * length))
    p.add_blocks(C, case.blocks)
    C.mult(case.y, case.r)
    wanted, y = p.unknowns(), p.bodies_part(case.y)
    of_bodies = (case.blocks @ y[:, :, None])[:, :, 0]
    p.collapse(np.zeros(case.d.array.size), of_bodies, wanted)
    wanted.axpy(-1.0, case.r)
    error = float(wanted.norm())
    C.destroy()
    wanted.destroy()
    return error


ERRORS = transposed, exact, moments, trial, at_rest, blocks


def findings(name):
    """Numbers, and errors of all maps. Collective."""
    case = Case(name)
    return {"numbers": numbers(case), **{check.__name__: check(case) for check in ERRORS}}


@pytest.fixture(scope="module")
def found():
    """Findings by the number of ranks and the name of the bar."""
    return {n: parallel.run(__file__, n, timeout=300) for n in (1, 3)}


@parallel.on_1_and_3_ranks
def test_unknowns_are_numbered(found, ranks):
    """Free dofs, then bodies, on each rank; a prescribed dof has no column."""
    for name, (free, nodal) in FREE.items():
        size = free + 6 * len(BARS[name][1])
        wanted = {"free": free, "size": size, "nodal": nodal}
        wanted |= dict.fromkeys(["in order", "owned once", "owners", "of PETSc"], True)
        assert found[ranks][name]["numbers"] == wanted, name


@parallel.on_1_and_3_ranks
@pytest.mark.parametrize("check", [c for c in ERRORS if c is not trial], ids=lambda c: c.__name__)
def test_maps(found, ranks, check):
    """To rounding."""
    for name, errors in found[ranks].items():
        assert errors[check.__name__] <= 2e-14, name


@parallel.on_1_and_3_ranks
def test_trial_side_is_the_derivative(found, ranks):
    """Fourth-order differences leave h⁴ = 1e-12, rounding 1e-13."""
    for name, errors in found[ranks].items():
        assert errors["trial"] <= 1e-11, name


if __name__ == "__main__":
    results = {name: findings(name) for name in BARS}
    if MPI.COMM_WORLD.rank == 0:
        parallel.report(results)
