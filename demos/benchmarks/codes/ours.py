"""rigidfx, as it comes."""

from __future__ import annotations

from contextlib import closing

from bench import timed

import rigidfx as rf

from .case import Case, Outcome


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
