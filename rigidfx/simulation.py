"""The only time loop: a generator of step reports.

    advance → report → decide → switch → next step

Steps end on the grid k Δt and on every breakpoint the scene declares; a step that had to be cut
shows up as several reports on the way to its end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import count
from time import perf_counter
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import SceneError, StepError
from rigidfx.base.inputs import shown
from rigidfx.base.log import heard, tell
from rigidfx.base.progress import progress_bar
from rigidfx.base.same_input import check_same
from rigidfx.decide.criteria.accuracy import Accuracy, controlled
from rigidfx.decide.criteria.judging import Criterion
from rigidfx.preparation import prepare
from rigidfx.report.account import Account, beginning
from rigidfx.report.brief_contacts import BriefContacts
from rigidfx.report.energy_balance import EnergyBalance
from rigidfx.report.jolts import Jolts
from rigidfx.report.lumping import LumpedInertia
from rigidfx.report.of_step import amended, report_of
from rigidfx.report.report import Report
from rigidfx.report.start import Start, start_of
from rigidfx.report.turned_springs import TurnedSprings
from rigidfx.run import Run
from rigidfx.scene.scene import Scene
from rigidfx.scene.step_control import StepControl
from rigidfx.scene.timeline import Timeline
from rigidfx.step.linear.petsc_options import SolverOptions
from rigidfx.step.system.supports import Impact

__all__ = ["simulate"]


def simulate(
    scene: Scene,
    dt: float | Mapping[float, float] | StepControl,
    t_end: float,
    *,
    rigidify: Criterion | None = None,
    accuracy: Accuracy | None = None,
    corrected: bool = True,
    start: Report | Start | None = None,
    progress: bool | None = None,
    verbose: bool | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    monitor: Callable[[int, float], None] | None = None,
) -> Iterator[Report]:
    """Integrate a scene from t = 0.

    Args:
        scene: The problem.
        dt: Nominal time step Δt [s], or one from each of several times on: {0: 0.01, 2.2: 0.002};
            or a `StepControl`, which chooses it by the error that it makes.
        t_end: End of the simulation [s].
        rigidify: When parts become rigid and flexible again; no part does if None.
        accuracy: How far off the motion may be: chooses Δt, of which dt is the largest, and what
            becomes rigid; in place of rigidify.
        corrected: Whether the error motion, where it is known, is added to the displacements and
            velocities that are shown, and to stresses and strains: of probes, in files and in
            pictures. That is with a `StrainRate` of wake="local"; `report.state`, energies, momenta
            and reactions are those of the run itself.
        start: Where the run begins, at rest or with the scene's `InitialVelocity`: the last report
            of `static`, say, of this scene or of another one on the same domain.
        progress: Whether rank 0 shows a progress bar on standard error; where that is a terminal
            if None.
        verbose: Whether rank 0 says on standard error what is compiled, what becomes rigid and
            flexible, and how the run ended; if None, where that is a terminal, and elsewhere only
            what a first run compiles. The logger "rigidfx" is told in any case, at the level INFO.
        petsc_options: Options of PETSc's solvers for this run, by name without a prefix:
            {"ksp_type": "bcgs", "pc_type": "asm"}. Those of the command line and of the
            environment win; see `rigidfx.step.linear.petsc_options`.
        monitor: Called with the number of each Newton iterate and ‖R‖ [N] there, on every rank
            that gives one; what it raises ends the run on all ranks.

    Returns:
        A generator of reports, the first of them of the initial state. Everything it holds is
        freed when it ends or is closed.

    Raises:
        SceneError: Before the first report, if dt or t_end cannot be used or the initial state is
            in conflict, or an option cannot be honoured; later, if a load takes a value that is
            not finite.
        StepError: If a step does not converge, even after cutting.
        InversionError: If a step turns flexible cells inside out, even after cutting.
    """
    if not isinstance(scene, Scene):
        raise SceneError(f"simulate: scene must be a Scene, got {type(scene).__name__}.")
    given = {"dt": dt, "t_end": t_end, "rigidify": rigidify, "accuracy": accuracy}
    check_same(scene.comm, "simulate", {**given, "petsc_options": petsc_options})
    for name, value in (("progress", progress), ("verbose", verbose), ("corrected", corrected)):
        if value is not None and not isinstance(value, (bool, np.bool_)):
            raise SceneError(f"simulate: {name} must be True, False or None, got {shown(value)}.")
    start = start_of(scene, start)
    if accuracy is not None:
        dt = controlled(accuracy, scene, dt, rigidify)
    control = dt if isinstance(dt, StepControl) else None
    if control is not None:
        control.check(scene)
        timeline = Timeline(control.most, t_end, control.least)
    else:
        timeline = Timeline(dt, t_end)  # type: ignore[arg-type]
        timeline.stop_at(scene.breakpoints)
    if isinstance(rigidify, Accuracy) or not isinstance(rigidify, Criterion | None):
        raise SceneError(f"simulate: rigidify must be a StrainRate, got {shown(rigidify)}.")
    criterion = rigidify if accuracy is None else accuracy.watching(scene)
    if criterion is not None and not scene.scheme.couples:
        raise SceneError(
            f"simulate: {type(scene.scheme).__name__} does not couple to rigid bodies; take "
            "EnergyMomentum or Midpoint."
        )
    if scene.comm.allreduce(monitor is not None, op=MPI.LOR) and monitor is None:
        monitor = _unheard
    solver = SolverOptions({} if petsc_options is None else petsc_options, monitor)
    with solver.at_work(), heard(scene.comm, verbose):
        began = perf_counter()
        run, impact = prepare(scene, timeline, criterion, control, start)
        idle = None if accuracy is None else accuracy.idle
        run = replace(run, idle=idle, corrected=bool(corrected))
        tell(scene.comm, beginning(scene, run.stepper.unknowns, t_end, perf_counter() - began))
    reports = _reports(run, impact, (progress, verbose), solver)
    if accuracy is None or control is None:
        return reports
    rule = None if run.policy is None else run.policy.rule
    finer = accuracy.finer(control)
    twin = partial(simulate, scene, finer, t_end, start=start, petsc_options=petsc_options)
    return accuracy.followed(reports, scene, rule, twin)


def _unheard(iteration: int, norm: float) -> None:
    """The monitor of a rank that has none where another has one: they are called together."""


def _reports(
    run: Run,
    impact: Impact | None,
    shown: tuple[bool | None, bool | None],
    solver: SolverOptions,
) -> Iterator[Report]:
    """Advance → report → decide → switch, step by step."""
    timeline, stepper, switch, state = run.timeline, run.stepper, run.switch, run.stepper.state
    scene, balance = stepper.scene, EnergyBalance(stepper.scene)
    brief = BriefContacts(scene, stepper.control is None)
    looks = balance, LumpedInertia(scene), Jolts(scene), brief, TurnedSprings(scene)
    account = Account(stepper.scene.comm)
    with (
        run,
        heard(stepper.scene.comm, shown[1]),
        account,
        progress_bar(stepper.scene.comm, timeline.t_end, shown[0]) as bar,
    ):
        report = report_of(0, stepper, run.probes, None, impact, run.shadows, run.added)
        report = replace(report, reactions=switch.held[0], reaction_moments=switch.held[1])
        report = run.accounted(report)
        for look in (*looks, account):
            look.follow(report)
        yield report
        for step in count(1):
            if timeline.over(state.t):
                stepper.failures.settle()
                return balance.end()
            target, start = run.target(), perf_counter()
            with solver.at_work():
                events = run.ahead(target)
                impact = switch.follow_effects(target - state.t)
                target = run.touch.before(target)
                try:
                    result, woken = run.advance(target, step)
                except StepError as error:
                    raise balance.explained(error) from None
                report = report_of(
                    step, stepper, run.probes, result, impact, run.shadows, run.added
                )
                now, closeness = run.after(report)
                report = amended(report, stepper, [*events, *woken, *now], closeness)
                report = run.accounted(report)
            if report.iterations > 0:
                solver.warn_of_unasked(stepper.scene.comm)
            for look in looks:
                look.follow(report)
            bar.update(result.dt)
            report = replace(report, wall=perf_counter() - start)
            account.follow(report)
            yield report
