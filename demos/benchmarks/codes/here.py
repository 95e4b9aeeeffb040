"""rigidfx as it comes, and the same scheme in DOLFINx with the better of two linear solvers."""

from contextlib import closing

import numpy as np
import ufl
from bench import timed
from bench.plain import LU_BELOW, SOLVERS, PlainLoop
from dolfinx import fem

import rigidfx as rf

from .case import Array, Case, Outcome


class Energies:
    """T + W of St.Venant and Kirchhoff's material, by the quadrature of the scene."""

    def __init__(self, case: Case, mass: str) -> None:
        """Compile the form, with lumped or consistent mass."""
        scene, material = case.scene, case.material
        self._u, self._v = fem.Function(scene.space), fem.Function(scene.space)
        lmbda = material.E * material.nu / ((1 + material.nu) * (1 - 2 * material.nu))
        mu = material.E / (2 * (1 + material.nu))
        F = ufl.Identity(3) + ufl.grad(self._u)
        E = (F.T * F - ufl.Identity(3)) / 2
        W = lmbda / 2 * ufl.tr(E) ** 2 + mu * ufl.inner(E, E)
        rule = (
            {"quadrature_rule": "GLL", "quadrature_degree": 2 * scene.order - 1}
            if mass == "lumped"
            else {"quadrature_degree": 2 * scene.order}
        )
        T = material.rho / 2 * ufl.inner(self._v, self._v)
        self._form = fem.form(W * scene.cell_measure + T * ufl.dx(domain=scene.mesh, metadata=rule))

    def __call__(self, u: Array, v: Array) -> float:
        """H [J] at displacements [m] and velocities [m/s] of the nodes, of any shape."""
        self._u.x.array[:] = np.ravel(u)
        self._v.x.array[:] = np.ravel(v)
        return float(fem.assemble_scalar(self._form))


def rigidfx(case: Case) -> Outcome:
    """Run a case."""
    outcome = Outcome()
    with closing(rf.simulate(case.scene, case.dt, case.steps * case.dt, progress=False)) as reports:
        next(reports)
        for _ in range(case.steps):
            seconds, report = timed(lambda: next(reports))
            outcome.seconds.append(seconds)
            outcome.newton.append(report.iterations)
            outcome.times.append(report.t)
            outcome.energies.append(report.energy)
        u = report.state.u.x.array.reshape(-1, 3)
        outcome.probe = case.nodes[case.probe] + u[case.probe]
        outcome.solver = report.solver
    return outcome


# Of the largest nodal force, where Newton's iteration may stop: rounding leaves 2e-9 in the bracket
# of steel, whose stiffness the forces of a step are small against.
ROUNDING = 1e-8


def loop(case: Case, solver: str) -> PlainLoop:
    """The plain loop of a case."""
    tractions = {
        name: lambda t, q=q: q * (case.factor(t) if t < case.free_from else 0.0)
        for name, q in case.tractions.items()
    }
    floor = ROUNDING * abs(case.forces).max()
    return PlainLoop(case.scene, case.dt, tractions, SOLVERS[solver], case.held, floor)


def cheaper(case: Case) -> str | None:
    """The solver with the cheaper third step; None if none gets so far."""
    cost = {}
    for solver in SOLVERS:
        if solver.startswith("lu") and case.unknowns > LU_BELOW:
            continue
        trial = loop(case, solver)
        try:
            cost[solver] = [timed(lambda: next(trial))[0] for _ in range(3)][-1]  # noqa: B023
        except RuntimeError:
            continue
    return min(cost, key=lambda name: cost[name], default=None)


def plain_dolfinx(case: Case) -> Outcome:
    """Run a case."""
    solver = cheaper(case)
    if solver is None:
        return Outcome(failed="no solver gets through three steps")
    steps, energy = loop(case, solver), Energies(case, case.scene.mass)
    outcome = Outcome(solver=solver)
    try:
        for _ in range(case.steps):
            seconds, step = timed(lambda: next(steps))
            outcome.seconds.append(seconds)
            outcome.newton.append(step.iterations)
            outcome.times.append(steps.t)
            outcome.energies.append(energy(steps.u0.x.array, steps.v0.x.array))
    except RuntimeError as error:
        outcome.failed = str(error)
    outcome.probe = case.nodes[case.probe] + steps.u0.x.array.reshape(-1, 3)[case.probe]
    return outcome
