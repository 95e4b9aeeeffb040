"""The only time loop: a generator of step reports.

    scene → integrator.step → Report → … → Recorder

Steps end on the grid k Δt and on every breakpoint the scene declares; a step that had to be cut
shows up as several reports on the way to its end.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from time import perf_counter
from typing import Any

from rigidfx.base.errors import SceneError, StepError
from rigidfx.decide.criterion import StrainRate
from rigidfx.report.energy_balance import EnergyBalance
from rigidfx.report.lumping import LumpedInertia
from rigidfx.report.probes import Probes
from rigidfx.report.report import Report, amended, report_of
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline
from rigidfx.step.stepper import Integrator
from rigidfx.switch.switching import Switching

__all__ = ["simulate"]


def simulate(
    scene: Scene,
    dt: float | Mapping[float, float],
    t_end: float,
    *,
    rigidify: StrainRate | None = None,
    progress: bool | None = None,
) -> Iterator[Report]:
    """Integrate a scene from t = 0.

    Args:
        scene: The problem.
        dt: Nominal time step Δt [s], or one from each of several times on: {0: 0.01, 2.2: 0.002}.
        t_end: End of the simulation [s].
        rigidify: When parts become rigid and flexible again; no part does if None.
        progress: Whether rank 0 shows a progress bar on standard error; where that is a terminal
            if None.

    Returns:
        A generator of reports, the first of them of the initial state. Everything it holds is
        freed when it ends or is closed.

    Raises:
        SceneError: Before the first report, if dt or t_end cannot be used or the initial state is
            in conflict; later, if a load takes a value that is not finite.
        StepError: If a step does not converge, even after cutting.
        InversionError: If a step turns flexible cells inside out, even after cutting.
    """
    if not isinstance(scene, Scene):
        raise SceneError(f"simulate: scene must be a Scene, got {scene!r}.")
    timeline = Timeline(dt, t_end)
    if rigidify is not None and not isinstance(rigidify, StrainRate):
        raise SceneError(f"simulate: rigidify must be a StrainRate, got {rigidify!r}.")
    if rigidify is not None and not scene.scheme.couples:
        raise SceneError(
            f"simulate: {type(scene.scheme).__name__} does not couple to rigid bodies; take "
            "EnergyMomentum or Midpoint."
        )
    probes = Probes(scene)
    integrator = Integrator(scene, timeline.dt, rigidify.measure if rigidify else None)
    switching = None
    if rigidify is not None:
        with ExitStack() as stack:
            stack.callback(integrator.close)
            switching = Switching(scene, rigidify, integrator, timeline)
            stack.pop_all()
    timeline.stop_at(scene.breakpoints)
    return _reports(scene, integrator, switching, probes, timeline, progress)


def _reports(
    scene: Scene,
    integrator: Integrator,
    switching: Switching | None,
    probes: Probes,
    timeline: Timeline,
    progress: bool | None,
) -> Iterator[Report]:
    with integrator, _progress_bar(scene, timeline.t_end, progress) as bar:
        step, state, balance = 0, integrator.state, EnergyBalance(scene)
        report = report_of(0, integrator, probes, None, integrator.measure())
        lumping = LumpedInertia(scene)
        balance.follow(report)
        lumping.follow(report)
        yield report
        while not timeline.over(state.t):
            target = timeline.next(state.t)
            start = perf_counter()
            events = switching.before(target - state.t) if switching else []
            try:
                result = integrator.step(target)
            except StepError as error:
                raise balance.explained(error) from None
            step += 1
            report = report_of(step, integrator, probes, result, integrator.measure())
            if switching is not None:
                now = switching.after(result, report)
                report = amended(report, integrator, [*events, *now], switching.closeness)
            balance.follow(report)
            lumping.follow(report)
            bar.update(result.dt)
            yield replace(report, wall=perf_counter() - start)


def _progress_bar(scene: Scene, t_end: float, progress: bool | None) -> Any:
    from tqdm import tqdm

    terminal = sys.stderr.isatty()
    return tqdm(
        total=t_end,
        disable=scene.comm.rank != 0 or not (terminal if progress is None else progress),
        unit="s",
        file=sys.stderr if terminal else _Lines(),
        mininterval=0.1 if terminal else 5.0,
        bar_format="{l_bar}{bar}| {n:.4g}/{total:.4g} s [{elapsed}<{remaining}]",
    )


class _Lines:
    """Standard error where it is no terminal: the bar as a line each time.

    mpirun passes on whole lines only, so that a bar that rewrites its line would not be seen.
    """

    def write(self, text: str) -> None:
        """Write a state of the bar, without what moves a cursor."""
        if text.strip():
            sys.stderr.write(text.strip() + "\n")

    def flush(self) -> None:
        """Flush standard error."""
        sys.stderr.flush()
