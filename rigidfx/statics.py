"""Statics: a path of equilibria under growing loads, as a generator of reports."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy, deepcopy
from dataclasses import dataclass, fields, replace
from functools import partial
from math import nan
from time import perf_counter
from typing import Any

import numpy as np

from rigidfx import effects as fx
from rigidfx.base.crowding import tell_of_crowding
from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import is_function, numbers, positive, shown, whole
from rigidfx.base.log import heard, tell
from rigidfx.base.taken import check_same
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.growth.shaping import Shaping
from rigidfx.inventory.inventory import check_clamps, divide
from rigidfx.linear.petsc_options import SolverOptions
from rigidfx.report.account import Whereabouts
from rigidfx.report.odd_motions import Stillness
from rigidfx.report.of_step import report_of
from rigidfx.report.probe_stress import Probes
from rigidfx.report.report import Report
from rigidfx.report.start import check_scene
from rigidfx.scene.doubts import warn_of_idle
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline
from rigidfx.shapes.shortening import Shortening
from rigidfx.state import State
from rigidfx.step.equations.supports import PrescribedDofs, supports_of
from rigidfx.step.load_path import LoadPath
from rigidfx.step.system.rigid_motion import free_to_move
from rigidfx.step.system.system import StepResult


def static(
    scene: Scene,
    steps: int | Sequence[float] = 10,
    *,
    t_end: float = 1.0,
    verbose: bool | None = None,
    petsc_options: Mapping[str, Any] | None = None,
) -> Iterator[Report]:
    """Find static equilibria of a scene under growing loads.

    The time t is the load parameter, from 0 to t_end. A constant load or pressure grows from zero
    to its value, in proportion to t while its window is open. Loads that are functions of time, and
    paths of supports and obstacles, have their values at t. Springs always act, damping does not,
    masses act by their weight only. A load step that fails is halved.

    Example:
        >>> with Recorder(scene, "out/bracket", every=1) as recorder:   # doctest: +SKIP
        ...     for report in static(scene, steps=10):
        ...         recorder.write(report)
        >>> run = simulate(scene, dt=1e-3, t_end=0.1, start=report)

    Args:
        scene: The problem. An `InitialDisplacement` is where the path begins.
        steps: Number of equal load steps, or the times at which they end, increasing; the last one
            is the end of the path then.
        t_end: Time at which loads are whole [s].
        verbose: Whether rank 0 says on standard error how it solves; see `simulate`.
        petsc_options: Options of PETSc's solvers, as of `simulate`.

    Returns:
        A generator of reports, the first of them of the state without loads. `report.t` is the time
        of the loads. Forces and reactions are those at the end of a load step.

    Raises:
        SceneError: Before the first report, if an argument cannot be used, or a rigid motion is
            left free; later, if a load takes a value that is not finite.
        StepError: At a limit load: where no equilibrium follows the last one, even after cuts.
        InversionError: If cells turn inside out, even after cuts.
    """
    check_scene("static", scene)
    check_same(scene.comm, "static", {"steps": steps, "t_end": t_end, "options": petsc_options})
    ends = _ends(steps, positive("static", "t_end", t_end))
    last = ends[-1]
    for effect in (e for e in scene.effects if e.in_runs):
        raise SceneError(
            f"static: {effect.kind} has no meaning in statics. Take {effect.in_runs}, or leave it "
            "out."
        )
    warn_of_idle(scene, last)
    ends = sorted({*ends, *(t for t in scene.breakpoints if 0 < t < last)})
    ramped = copy(scene)
    ramped.effects = tuple(_ramped(effect, last) for effect in scene.effects)
    loose = _check_held(ramped, ends)
    solver = SolverOptions({} if petsc_options is None else petsc_options, None)
    return _reports(scene, ramped, ends, verbose, solver, loose)


@dataclass(frozen=True)
class Compliance:
    """Static displacements of probes with and without rigid and reduced parts, and rigid faces.

    Attributes:
        flexible: Displacement of each probe with all parts flexible, shape (3,) [m].
        rigid: The same with them, likewise.
        parts: Kinds of the parts.
    """

    flexible: Mapping[str, Array]
    rigid: Mapping[str, Array]
    parts: str = "rigid"

    @property
    def taken(self) -> Mapping[str, float]:
        """By which part of its displacement without such parts each probe is off; NaN at rest."""
        sizes = {name: float(np.linalg.norm(u)) for name, u in self.flexible.items()}
        return {
            name: float(np.linalg.norm(self.rigid[name] - u)) / sizes[name] if sizes[name] else nan
            for name, u in self.flexible.items()
        }

    def __str__(self) -> str:
        changed = self.parts + " parts change its displacement by {:.2%}"
        taken = {k: changed.format(v) if v == v else "at rest" for k, v in self.taken.items()}
        return "\n".join(f"{name}: {part}" for name, part in taken.items())


def compliance(scene: Scene, steps: int | Sequence[float] = 1, *, t_end: float = 1.0) -> Compliance:
    """Change of displacements by parts named `Rigid` or `Reduced` and rigid faces, from statics.

    Nothing in a run tells it, since these parts get no shapes for it. The other solution has a
    `MeanFace` in place of each `RigidFace`.

    Example:
        >>> print(compliance(scene))   # doctest: +SKIP
        tip: rigid parts change its displacement by 3.10%

    Args:
        scene: The problem, with its loads as `static` takes them. Initial velocities and a preload
            have no part.
        steps: Load steps, as of `static`.
        t_end: Time at which loads are whole [s].

    Raises:
        SceneError: If nothing is named rigid, there is no probe, no load moves any, or `static`
            cannot use the scene.
        StepError: As of `static`.
    """
    check_scene("compliance", scene)
    rigid = bool(scene.named(fx.Rigid) or fx.rigid_faces(scene.effects))
    if not rigid or not scene.probes:
        lacking = "probe" if rigid else "Rigid or Reduced part and no RigidFace"
        raise SceneError(
            f"compliance: the scene has no {lacking}. It compares displacements of probes with and "
            "without the parts that are named so, and with mean faces in place of rigid ones."
        )

    def displacements(effects: Iterable[fx.Effect]) -> Mapping[str, Array]:
        loaded = copy(scene)
        loaded.effects = tuple(effects)
        known = {id(effect) for effect in scene.effects}
        loaded.effects = tuple(e if id(e) in known else e.placed(loaded) for e in loaded.effects)
        *_, last = static(loaded, steps, t_end=t_end, verbose=False)
        return last.probes

    acting = [e for e in scene.effects if not e.in_runs]
    soft = (_with_mean_faces(e) for e in acting if not e.is_body)
    kinds = {"reduced" if e.deforms else "rigid" for e in scene.named(fx.Rigid)}
    parts = " and ".join(sorted(kinds, reverse=True)) or "rigid"
    found = Compliance(displacements(soft), displacements(acting), parts)
    if not any(u.any() for u in found.flexible.values()):
        raise SceneError(
            f"compliance: no load moves a probe ({', '.join(found.flexible)}) up to t = {t_end:g} "
            "s. Add the loads of the run, or a unit force at the place of interest."
        )
    return found


def _with_mean_faces(effect: fx.Effect) -> fx.Effect:
    """An effect with mean faces in place of its rigid ones, which has no places then."""
    given = {own.name: getattr(effect, own.name) for own in fields(effect)}
    mean = {name: fx.MeanFace(v.where) for name, v in given.items() if isinstance(v, fx.RigidFace)}
    return replace(effect, **mean) if mean else effect


def _reports(
    scene: Scene,
    ramped: Scene,
    ends: Sequence[float],
    verbose: bool | None,
    solver: SolverOptions,
    loose: bool,
) -> Iterator[Report]:
    """Load step by load step."""
    state = State(scene)
    if scene.named(fx.InitialDisplacement):
        state.place((scene.start_places - state.X).reshape(-1))
    forces = InternalForces(ramped, state.u, ())
    shaping = None if loose else _shaping(ramped, forces, ends)
    shape = None if shaping is None else partial(shaping.shaped, state)
    path = LoadPath(
        ramped,
        state,
        forces,
        ramped.effects,
        lambda acting: divide(ramped, forces, state, supports_of(acting), (), shape),
        "static",
        loose=loose,
    )
    probes, number, shortening = Probes(scene), 0, None
    if shaping is not None:
        shortening = Shortening(scene, probes.points, shaping.about)
    looks = Whereabouts(scene.comm, ends[-1]), Stillness(scene)
    try:
        with heard(scene.comm, verbose), solver.at_work():
            tell_of_crowding(scene.comm)
            check_clamps(scene, Timeline(ends[-1], ends[-1]))
            path.follow(0.5 * ends[0])
            _tell_of_shapes(scene, state, shaping)
            tell(scene.comm, f"Statics of {path.unknowns} unknowns, {len(ends)} load steps.")
            report = report_of(0, path, probes, None, None, shortening)
            steps = _Steps(path, shaping, ends)
        yield report
        for end in ends:
            path.follow(0.5 * (state.t + end))
            while state.t < end:
                began = perf_counter()
                with heard(scene.comm, verbose), solver.at_work():
                    result = steps.advanced(end)
                    number += 1
                    report = report_of(number, path, probes, result, None, shortening)
                    tell(
                        scene.comm,
                        f"t = {state.t:.6g} s: {report.iterations} iterations, {result.cuts} cuts",
                    )
                    for look in looks:
                        look.follow(report)
                if report.iterations > 0:
                    solver.warn_of_unasked(scene.comm)
                yield replace(report, wall=perf_counter() - began, nu=steps.nu())
        looks[1].end()
    finally:
        path.close()
        if shaping is not None:
            shaping.destroy()


class _Steps:
    """Load steps, all of them again with Γ of parts once stresses stiffen these."""

    def __init__(self, path: LoadPath, shaping: Shaping | None, ends: Sequence[float]) -> None:
        """Begin where the path is; without shaping no parts are looked at."""
        self._path, self._shaping, self._ends = path, shaping, ends
        self._start = path.state.snapshot(), deepcopy(path.state.notes)
        self._tense: frozenset[str] = frozenset()

    def advanced(self, end: float) -> StepResult:
        """The load step to an end [s], or towards it. Collective."""
        result, shaping, state = self._path.advance(end), self._shaping, self._path.state
        while shaping is not None and (taut := shaping.spent.taut(state.bodies) - self._tense):
            self._tense |= taut
            result = self._again(shaping, taut)
        return result

    def nu(self) -> dict[str, float]:
        """ν of the parts. Collective."""
        return {} if self._shaping is None else self._shaping.spent.follow(self._path.state)

    def _again(self, shaping: Shaping, taut: frozenset[str]) -> StepResult:
        """The load steps up to now, with Γ of parts by their names; the last one. Collective."""
        path, state, there = self._path, self._path.state, self._path.state.bodies
        ends = [*(t for t in self._ends if t < state.t), state.t]
        state.restore(self._start[0])
        state.notes = deepcopy(self._start[1])
        state.group(shaping.tensed(state.bodies, there, taut))
        self._start = state.snapshot(), self._start[1]
        path.begin_again(0.5 * (state.t + ends[0]))
        for stop in ends:
            path.follow(0.5 * (state.t + stop))
            while state.t < stop:
                result = path.advance(stop)
        return result


def _tell_of_shapes(scene: Scene, state: State, shaping: Shaping | None) -> None:
    """Warn of loads that shapes do not span, or log that reduced parts are flexible. Collective."""
    if shaping is not None:
        shaping.warn_of_unspanned(state)
    elif reduced := scene.named(fx.Reduced):
        names = ", ".join(f"'{part.name}'" for part in reduced)
        tell(
            scene.comm,
            f"Reduced {names}: flexible in these statics, as shapes are not known of contacts "
            "before they close, nor of parts that these alone hold.",
        )


def _shaping(scene: Scene, forces: InternalForces, ends: Sequence[float]) -> Shaping | None:
    """Shapes of reduced parts; None without any, and with contacts, whose nodes are not known."""
    if not scene.named(fx.Reduced) or scene.named(fx.Contact):
        return None
    acting = [e for e in scene.named(fx.Windowed) if e.acts(0.5 * ends[0])]
    return Shaping(scene, forces, acting, ends[-1], np.inf)


def _ends(steps: int | Sequence[float], t_end: float) -> list[float]:
    """Times at which load steps end; `SceneError` unless a number ≥ 1, or rising from above 0."""
    if np.ndim(steps) == 0:
        count = whole("static", "steps", steps, least=1)
        return [k / count * t_end for k in range(1, count + 1)]
    times = numbers(steps)
    good = times.ndim == 1 and times.size > 0 and np.isfinite(times).all()
    if not good or times[0] <= 0 or (np.diff(times) <= 0).any():
        raise SceneError(
            f"static: steps must be a whole number ≥ 1, or times > 0 that increase, got "
            f"{shown(steps)}."
        )
    return [float(t) for t in times]


def _ramped(effect: Any, t_end: float) -> fx.Effect:
    """A constant load, or force of a motor, as one that grows; any other effect as it is."""
    if effect.grows is None:
        return effect
    given = getattr(effect, effect.grows)
    start, end = effect.start, min(t_end, effect.until)
    if is_function(given) or is_function(getattr(effect, "value", None)) or not start < end:
        return effect
    table = fx.Table((start, end), (0.0, 1.0 if given is None else float(given)))
    out = replace(effect, **{effect.grows: table})
    return out if effect.face is None else out.with_point(effect.remote)


def _check_held(scene: Scene, ends: Sequence[float]) -> bool:
    """Whether loads on a mechanism, or contacts, are to hold a rigid motion. Collective.

    A warning tells of contacts that do not; `SceneError` on every rank if nothing does.
    """
    loose, warned = False, False
    for begin, end in zip([0.0, *ends], ends, strict=False):
        acting = [e for e in scene.named(fx.Windowed) if e.acts(0.5 * (begin + end))]
        contacts = [e for e in acting if e.is_contact]
        held = PrescribedDofs(scene, supports_of(acting))
        if not (free := free_to_move(scene, held, acting=acting)):
            continue
        what = f"static: from t = {begin:g} s on supports, springs and joints leave a rigid motion "
        if not contacts and not scene.named(fx.Joint) and not scene.named(fx.SpringDamper):
            raise SceneError(
                f"{what}free, of {free}, so there is no static equilibrium. Add supports, or a "
                "weak Spring."
            )
        loose = True
        if warned or not contacts or any(isinstance(c.against, str) for c in contacts):
            continue  # where two surfaces will meet is not known
        directions = [c.directions(scene) for c in contacts]
        if free := free_to_move(scene, held, directions, acting):
            warned = True
            warn(
                scene.comm,
                f"{what}free, of {free}, along which contacts without friction do not hold either: "
                "the place along it is arbitrary. Add supports, friction, or a weak Spring.",
            )
    return loose
