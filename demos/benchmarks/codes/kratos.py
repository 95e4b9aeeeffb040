"""Kratos (`KratosStructuralMechanicsApplication`), run by the Python that has it."""

from pathlib import Path

import numpy as np
from bench import by_another_python

from .case import Case, Outcome
from .here import Energies

SCRIPT = Path(__file__).with_name("kratos_steps.py")
SOLVERS = ("amgcl", "sparse_lu")
TRIAL = 2  # steps, from which the solver is chosen
TRIAL_AT_MOST = 120  # s


def kratos(case: Case, python: str, folder: Path) -> Outcome:
    """Run a case with the better of two linear solvers, by the Python that has Kratos."""
    folder.mkdir(parents=True, exist_ok=True)
    given, material = folder / f"{case.name.replace(' ', '_')}.npz", case.material
    np.savez(
        given,
        nodes=case.nodes,
        cells=case.cells + 1,
        forces=case.forces,
        times=np.append(case.factor.times, case.dt * (case.steps + 1)),
        factors=np.append(case.factor.values, 0.0),
        held=case.held_nodes + 1,
        material=(material.E, material.nu, material.rho),
        dt=case.dt,
    )

    def call(solver: str) -> tuple[str, Path, Path, Path, str]:
        return python, SCRIPT, given, given.with_suffix(f".{solver}.npz"), solver

    cost = {}
    for solver in SOLVERS:
        trial = by_another_python(*call(solver), str(TRIAL), at_most=TRIAL_AT_MOST)
        if not isinstance(trial, str):
            cost[solver] = float(trial["seconds"][-1])
    if not cost:
        return Outcome(failed=f"no step: {trial}")
    solver = min(cost, key=lambda name: cost[name])
    outcome = Outcome(solver=solver)
    found = by_another_python(*call(solver), str(case.steps))
    if isinstance(found, str):
        outcome.failed = found
        return outcome
    outcome.seconds, outcome.newton = found["seconds"].tolist(), found["newton"].tolist()
    outcome.failed = str(found["failed"])
    energy = Energies(case, "consistent")
    outcome.times = [case.dt * k for k in range(1, 1 + len(found["u"]))]
    outcome.energies = [energy(u, v) for u, v in zip(found["u"], found["v"], strict=True)]
    if len(found["u"]):
        outcome.probe = case.nodes[case.probe] + found["u"][-1][case.probe]
    return outcome
