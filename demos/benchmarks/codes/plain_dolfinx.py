"""The same scheme written in DOLFINx and petsc4py, with the better of two linear solvers."""

from __future__ import annotations

from bench import timed
from bench.plain import PlainLoop

from .case import Case, Outcome
from .energies import Energies

SOLVERS = {
    "gmres+ilu": {"ksp_type": "gmres", "pc_type": "ilu", "ksp_rtol": "1e-8"},
    "lu (mumps)": {
        "ksp_type": "preonly",
        "pc_type": "lu",
        "pc_factor_mat_solver_type": "mumps",
    },
}
LU_BELOW = 50_000  # unknowns; beyond, a factorisation takes gigabytes and most of a minute
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
