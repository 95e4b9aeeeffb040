"""The only time loop: a generator of step reports.

    advance → report → decide → switch → next step

Steps end on the grid k Δt and on every breakpoint the scene declares; a step that had to be cut
shows up as several reports on the way to its end.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.crowding import tell_of_crowding
from rigidfx.base.errors import SceneError, StepError, together
from rigidfx.base.inputs import number, path_of
from rigidfx.base.inputs import shown as show
from rigidfx.base.instants import longer
from rigidfx.base.log import heard, tell
from rigidfx.base.progress import progress_bar
from rigidfx.base.taken import check_same
from rigidfx.base.warning import warn
from rigidfx.checkpoint.keeper import Checkpoint, Keeper, Kept, read
from rigidfx.decide.accuracy import Accuracy, controlled
from rigidfx.decide.settings import Criterion, without_effect
from rigidfx.linear.petsc_options import SolverOptions
from rigidfx.preparation import prepare
from rigidfx.report.account import Account, beginning
from rigidfx.report.blows import BriefContacts, BriefStops
from rigidfx.report.energy_balance import EnergyBalance
from rigidfx.report.fast_changes import AlternatingForces, FastLoads
from rigidfx.report.odd_motions import Jolts, LumpedInertia, Overdamped, Stillness, TurnedSprings
from rigidfx.report.of_step import amended, preloaded, report_of
from rigidfx.report.report import Report
from rigidfx.report.start import Start, start_of
from rigidfx.report.writers import Writers
from rigidfx.run import Run
from rigidfx.scene.doubts import warn_of_idle, warn_of_short_steps
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import StepControl, Timeline
from rigidfx.step.equations.supports import Impact
from rigidfx.step.stepper import Stepper


def simulate(
    scene: Scene,
    dt: float | Mapping[float, float] | StepControl,
    t_end: float,
    *,
    rigidify: Criterion | None = None,
    accuracy: Accuracy | None = None,
    corrected: bool | None = None,
    start: Report | Start | None = None,
    progress: bool | None = None,
    verbose: bool | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    monitor: Callable[[int, float], None] | None = None,
    checkpoint: Checkpoint | None = None,
) -> Iterator[Report]:
    """Integrate a scene from t = 0.

    Args:
        scene: The problem.
        dt: Nominal time step Δt [s], or one from each of several times on: {0: 0.01, 2.2: 0.002};
            or a `StepControl`, which chooses it by the error that it makes.
        t_end: End of the simulation [s].
        rigidify: When parts become rigid and flexible again; no part does if None.
        accuracy: Permitted error of the motion: chooses Δt, of which dt is the largest, and rigid
            parts; in place of rigidify.
        corrected: Without effect, for one release: there is one motion.
        start: Where the run begins, at rest or with the scene's `InitialVelocity`: the last report
            of `static`, say, of this scene or of another one on the same domain.
        progress: Whether rank 0 shows a progress bar on standard error; where that is a terminal
            if None.
        verbose: Whether rank 0 writes messages to standard error: compilation, switches, the end of
            the run. If None, a terminal gets all of them, and a file or pipe only compilation and
            the progress once a minute. The logger "rigidfx" gets all, at the level INFO.
        petsc_options: Options of PETSc's solvers for this run, by name without a prefix:
            {"ksp_type": "bcgs", "pc_type": "asm"}. Those of the command line and of the
            environment win; see `rigidfx.linear.petsc_options`.
        monitor: Called with the number of each Newton iterate and ‖R‖ [N] there, on every rank that
            gives one; an exception ends the run on all ranks.
        checkpoint: When and where the run leaves checkpoints for `resume`; none if None.

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
    others = {"petsc_options": petsc_options, "checkpoint": checkpoint}
    check_same(scene.comm, "simulate", given | others)
    for name, value in (("progress", progress), ("verbose", verbose)):
        if value is not None and not isinstance(value, (bool, np.bool_)):
            raise SceneError(f"simulate: {name} must be True, False or None, got {show(value)}.")
    if not isinstance(checkpoint, Checkpoint | None):
        raise SceneError(f"simulate: checkpoint must be a Checkpoint, got {show(checkpoint)}.")
    start = start_of(scene, start)
    if scene.comm.allreduce(monitor is not None, op=MPI.LOR) and monitor is None:
        monitor = _unheard
    former = [] if corrected is None else ["simulate: corrected"]
    for own in (rigidify, accuracy):
        if isinstance(own, (Criterion, Accuracy)):
            former += [f"{type(own).__name__}: {name}" for name in without_effect(own)]
    for name in former:
        warn(scene.comm, f"{name} has no effect, as bodies get shapes. Leave it out.")
    call = {**given, "petsc_options": petsc_options}
    return _begun(scene, call, (progress, verbose), monitor, start, checkpoint)


def resume(
    folder: str | Path,
    scene: Scene,
    *,
    t_end: float | None = None,
    dt: float | Mapping[float, float] | StepControl | None = None,
    rigidify: Criterion | None = None,
    accuracy: Accuracy | None = None,
    checkpoint: Checkpoint | None = None,
    progress: bool | None = None,
    verbose: bool | None = None,
    monitor: Callable[[int, float], None] | None = None,
) -> Iterator[Report]:
    """Go on with a run from its newest checkpoint, on any number of ranks.

    The first report is that of the step after the checkpoint. On the same number of ranks the
    motion is the same as that of the first run, on other ranks to Newton's tolerance.

    Args:
        folder: The folder of its `Checkpoint`.
        scene: The problem, made as for the first run.
        t_end: Another end of the simulation [s]; not with a `StepControl` or an `Accuracy`.
        dt: Argument of the first run, if it contained a function or a class of your own, which no
            file keeps. An error names a missing one.
        rigidify: As for dt.
        accuracy: As for dt.
        checkpoint: When and where the run leaves checkpoints from now on; as before, in this
            folder, if None.
        progress: See `simulate`.
        verbose: See `simulate`.
        monitor: See `simulate`.

    Yields:
        Reports, as of `simulate`.

    Raises:
        SceneError: On every rank, if there is no checkpoint, if it is of another mesh, scene or
            version, or if something has to be given again.
        OutputError: On every rank, if the folder cannot be read.
    """
    if not isinstance(scene, Scene):
        raise SceneError(f"resume: scene must be a Scene, got {type(scene).__name__}.")
    again = {"dt": dt, "rigidify": rigidify, "accuracy": accuracy}
    check_same(scene.comm, "resume", {**again, "t_end": t_end, "checkpoint": checkpoint})
    if not isinstance(checkpoint, Checkpoint | None):
        raise SceneError(f"resume: checkpoint must be a Checkpoint, got {show(checkpoint)}.")
    if t_end is not None:
        t_end = number("resume", "t_end", t_end)
    own = together(scene.comm, "resume", lambda: path_of("resume", "folder", folder))
    place: Path = scene.comm.bcast(own)
    kept = read(place, scene)
    call = kept.given_again(again)
    if t_end is not None:
        fixed = isinstance(call["dt"], StepControl) or call["accuracy"] is not None
        if fixed and t_end != call["t_end"]:
            raise SceneError("resume: t_end cannot change where errors add up to it. Leave it out.")
        if longer(kept.t, t_end):
            raise SceneError(
                f"resume: t_end = {t_end:g} s is before the checkpoint, which is at t = "
                f"{kept.t:g} s. Give a later end, or leave it out."
            )
        call["t_end"] = t_end
    if not longer(call["t_end"], kept.t):
        warn(
            scene.comm,
            f"resume: the run in '{place}' is over, as its last checkpoint is at its end, t = "
            f"{call['t_end']:g} s: there are no further steps. Give a later t_end, or read its "
            "results.",
        )
    left = call.pop("checkpoint")
    checkpoint = replace(left, folder=place) if checkpoint is None else checkpoint
    if scene.comm.allreduce(monitor is not None, op=MPI.LOR) and monitor is None:
        monitor = _unheard
    return _begun(scene, call, (progress, verbose), monitor, None, checkpoint, kept, place)


def _begun(
    scene: Scene,
    call: Mapping[str, Any],
    shown: tuple[bool | None, bool | None],
    monitor: Callable[[int, float], None] | None,
    start: Start | None,
    checkpoint: Checkpoint | None,
    kept: Kept | None = None,
    before: Path | None = None,
) -> Iterator[Report]:
    """A run that was prepared, at its start or at a checkpoint. Collective."""
    dt, t_end, accuracy = call["dt"], call["t_end"], call["accuracy"]
    rigidify, petsc_options = call["rigidify"], call["petsc_options"]
    if accuracy is not None:
        if checkpoint is not None and accuracy.check:
            raise SceneError(
                "Checkpoint: Accuracy(check=True) has a twin beside the run, which no checkpoint "
                "keeps. Leave check or the checkpoint out."
            )
        dt = controlled(accuracy, scene, dt, rigidify)
    control = dt if isinstance(dt, StepControl) else None
    timeline = _timeline(scene, dt, t_end)
    if checkpoint is None:  # else it may go on, to a later end
        warn_of_idle(scene, timeline.t_end)
    if kept is None and control is None:
        warn_of_short_steps(scene, timeline.dt)
    if not isinstance(rigidify, Criterion | None):
        raise SceneError(f"simulate: rigidify must be a StrainRate, got {show(rigidify)}.")
    criterion = rigidify if accuracy is None else accuracy.criterion(scene)
    if criterion is not None and not scene.scheme.couples:
        raise SceneError(
            f"simulate: {type(scene.scheme).__name__} does not couple to rigid bodies; take "
            "EnergyMomentum or Midpoint."
        )
    solver = SolverOptions({} if petsc_options is None else petsc_options, monitor)
    with solver.at_work(), heard(scene.comm, shown[1]):
        tell_of_crowding(scene.comm)
        began = perf_counter()
        back = None if kept is None else kept.bring_back
        idle = None if accuracy is None else accuracy.idle
        run, impact = prepare(scene, timeline, criterion, control, start, back, idle=idle)
        left = None if checkpoint is None else checkpoint.folder
        looks, writers = _looks(run), Writers(scene.comm, left, before)
        if kept is not None:
            kept.remember(run, (*looks, writers))
        keeper = None
        if checkpoint is not None:
            call = {**call, "checkpoint": checkpoint}
            keeper = Keeper(run, (*looks, writers), checkpoint, call, kept, before)
        tell(scene.comm, beginning(scene, run.stepper.unknowns, t_end, perf_counter() - began))
    first = 0 if kept is None else kept.step
    reports = _reports(run, impact, shown, solver, looks, writers, keeper, first)
    if accuracy is None or control is None:
        return reports
    finer = accuracy.finer(control)
    twin = partial(simulate, scene, finer, t_end, start=start, petsc_options=petsc_options)
    return accuracy.followed(reports, scene, run.policy is not None, twin)


def _timeline(scene: Scene, dt: Any, t_end: float) -> Timeline:
    """Where steps end."""
    if isinstance(dt, StepControl):
        dt.check(scene)
        return Timeline(dt.most, t_end, dt.least)
    timeline = Timeline(dt, t_end)
    timeline.stop_at(scene.breakpoints)
    return timeline


def _looks(run: Run) -> tuple[Any, ...]:
    """The readers of reports: that of the balance of energy first, the account last. Collective."""
    scene = run.stepper.scene
    given, t_end = run.stepper.control is None, run.timeline.t_end
    brief = BriefContacts(scene, given)
    of_motion = EnergyBalance(scene), Stillness(scene), LumpedInertia(scene), Jolts(scene), brief
    others = BriefStops(scene), TurnedSprings(scene), Overdamped(scene)
    of_forces = AlternatingForces(scene, run.stepper.alternation, t_end)
    of_loads = FastLoads(scene, run.stepper.jumps, given)
    return *of_motion, *others, of_forces, of_loads, Account(scene.comm, t_end)


def _over(stepper: Stepper, looks: tuple[Any, ...]) -> None:
    """Let all who follow a run know that it is over. Collective."""
    stepper.end()
    for look in looks[:-1]:
        look.end()


def _unheard(iteration: int, norm: float) -> None:
    """The monitor of a rank that has none where another has one: they are called together."""


def _reports(
    run: Run,
    impact: Impact | None,
    shown: tuple[bool | None, bool | None],
    solver: SolverOptions,
    looks: tuple[Any, ...],
    writers: Writers,
    keeper: Keeper | None,
    first: int,
) -> Iterator[Report]:
    """Advance → report → decide → switch, step by step, from the state after the first one."""
    timeline, stepper, switch, state = run.timeline, run.stepper, run.switch, run.stepper.state
    scene, (balance, *_, account) = stepper.scene, looks
    with (
        run,
        heard(scene.comm, shown[1]),
        account,
        nullcontext() if keeper is None else keeper,
        progress_bar(scene.comm, timeline.t_end, shown[0]) as bar,
    ):
        bar.update(state.t)
        if not first:
            known = run.shortening, run.recovery
            report = report_of(0, stepper, run.probes, None, impact, *known)
            report = replace(preloaded(report, scene, *switch.held), _writers=writers)
            report = run.accounted(report)
            for look in looks:
                look.follow(report)
            yield report
        for step in count(first + 1):
            over = timeline.over(state.t)
            if keeper is not None:
                with solver.at_work():
                    keeper.look(step - 1, state.t, over)
            if over:
                return _over(stepper, looks)
            target, start = run.target(), perf_counter()
            with solver.at_work():
                events = run.ahead(target)
                impact = run.switch.follow_effects(target - state.t)
                target = run.touch.before(target)
                try:
                    result, woken = run.advance(target, step)
                except StepError as error:
                    raise balance.explained(error) from None
                known = run.shortening, run.recovery
                report = report_of(step, stepper, run.probes, result, impact, *known)
                now, closeness = run.after(report)
                report = amended(report, stepper, [*events, *woken, *now], closeness)
                report = run.accounted(report)
            if report.iterations > 0:
                solver.warn_of_unasked(scene.comm)
            for look in looks[:-1]:
                look.follow(report)
            bar.n = min(report.t, timeline.t_end)  # sums of steps may be more
            bar.update(0)
            report = replace(report, wall=perf_counter() - start, _writers=writers)
            account.follow(report)
            yield report
