"""A path of load steps: each is solved, looked at, cut where it fails, and accepted.

    R(u₁) = f_int(u₁) + f_contact(u₁) - f_ext(t₁) = 0

Newton steps are taken whole first. Where that fails, they are shortened by a line search with
backtracking (J. E. Dennis and R. B. Schnabel, Numerical Methods for Unconstrained Optimization and
Nonlinear Equations, 1996, Section 6.3). A load step is cut where that fails too, where it turns
cells inside out, and where its increment is several times that of the step before and does not
shrink as the step does. Such a jump, or a failure that no cut mends, is a limit load.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import nextafter
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.errors import SceneError, StepError
from rigidfx.base.types import Array
from rigidfx.effects import Contact, Effect, Motor, Preload, Structure, Windowed
from rigidfx.effects.damping import StaticForces, StepDrag
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.inversion import Inversion
from rigidfx.linear.linear_solver import PREFIX, default_options
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.division import Division
from rigidfx.step.equations.energies import Measures
from rigidfx.step.equations.supports import PrescribedDofs, supports_of
from rigidfx.step.newton.first_guess import Guess
from rigidfx.step.newton.newton import Newton, Solution
from rigidfx.step.system.rigid_motion import free_to_move
from rigidfx.step.system.system import StepResult, System, Work
from rigidfx.step.watches.alternation import NEGLIGIBLE
from rigidfx.step.watches.judge import Cuts, inverted, overload


@dataclass(frozen=True)
class SettlingControl:
    """How the drag is chosen; s is over the load per mass and size of the whole."""

    # s of the first load step: it moves parts by a thousandth of their size or less
    first: float = 1000.0
    # Least s, which keeps motions regular that nothing holds, but that no load drives
    least: float = 1e-4
    change: float = 3.0  # factor of s from solve to solve
    # Motion of a solve, over the size of the whole, up to which the next one has less drag; with
    # contacts over that of a cell, as surfaces are not to pass through each other
    near: float = 0.1
    # Motion above which a solve is repeated with more drag: it may lead past an equilibrium
    far: float = 0.3
    rest: float = 1e-11  # drag over the loads that counts as nothing
    # Drag over the loads that does not fade, along a motion that nothing holds, which counts as
    # nothing: contacts of meshes have such forces across
    drifts: float = 1e-6
    solves: int = 100  # solves of a load step before it is said to have no end


class Settling:
    """The drag of a load path, and its course.

    Contacts or loads alone hold a chain, a pendulum or a block on a floor, and the tangent of
    statics is singular where they do not yet. The drag of `StepDrag` makes it regular. Each solve
    draws the parts to the last solution, and the next one has a third of the drag. It ends where
    the drag is nothing against the loads. Where a solve fails the drag is taken three times as
    large.

    Attributes:
        effect: The drag, to be bound with the effects that act.
    """

    def __init__(self, scene: Scene) -> None:
        """Measure the whole. Collective."""
        self._control = SettlingControl()
        self.effect = StaticForces(self._bind)
        self._size = scene.parts.extent
        self._mass = float(scene.sum(scene.averaging_mass[: scene.owned_nodes].sum()))
        stiffness = max(material.stiffness for material, _ in scene.materials) * self._size
        self._least = float(np.cbrt(np.finfo(np.float64).eps)) ** 2 * stiffness / self._mass
        self._s, self._near = self._control.first, self._control.near
        if scene.named(Contact):
            self._near *= scene.mean_cell_size / self._size

    def _bind(self, structure: Structure) -> StepDrag:
        self._forces = StepDrag(structure)
        return self._forces

    def solve(self, path: LoadPath, t0: float, t1: float) -> Solution:
        """Find an equilibrium at t₁ from that at t₀; the state is not changed. Collective.

        The path's equations have the drag. The last solve is returned, with the cost of all; it has
        not converged if parts do not come to rest.
        """
        control, forces = self._control, self._forces
        load = path.load(t1, t1 - t0)
        unit = max(load / (self._mass * self._size), self._least)
        force = unit * self._mass * self._size
        last, pose = path.at_rest, path.state.bodies.pose
        joints = path.system.constraints
        forces.draw_to(last.increment, pose)
        first: Guess | None = None
        left = np.inf  # drag over loads
        solution: Solution | None = None
        for _ in range(control.solves):
            forces.rate = self._s * unit
            if joints is not None:
                joints.drag = forces.rate
            with np.errstate(over="ignore", invalid="ignore"):  # it may run away, and fails then
                solution = path.solve(t0, t1, first).after(solution)
            found, pose = path.found, path.system.increments.end.pose
            moved = path.distance(found, last) / self._size
            if not solution.converged or moved > control.far:
                self._s *= control.change
                continue
            first = found
            left, before = self._s * moved, left
            if left <= max(control.rest, solution.rounding / force):
                return solution
            if before <= 2 * left <= 2 * control.drifts:
                return solution
            forces.draw_to(first.increment, pose)
            last = first
            if moved < self._near:
                self._s = max(self._s / control.change, control.least)
        assert solution is not None
        return replace(solution, converged=False)


@dataclass(frozen=True)
class PathControl:
    """When a load step is cut."""

    # Growth of the largest increment per load, from step to step, that is looked at more closely.
    # Before a limit point, where u_c - u grows with √(t_c - t), it is at most 2.5.
    jump: float = 4.0
    # A continuous path has at most this part of an increment in half the load step
    shrinks: float = 0.8
    # Ratio of the load per displacement to that of the first step below which an end of the path is
    # told as a limit load
    soft: float = 0.5


class LoadPath:
    """Statics of a scene, load step by load step; `close` frees it.

    Attributes:
        scene: The problem.
        state: Its state, whose time is that of the loads.
        indicator: None: nothing is measured to become rigid.
        system: The equations; those of the division and of the effects that act.
        t: Where the path is [s].
        share: Part of the loads that acts in the present load step.
    """

    indicator = None

    def __init__(
        self,
        scene: Scene,
        state: State,
        forces: InternalForces,
        effects: Sequence[Effect],
        divide: Callable[[Sequence[Windowed]], Division],
        owner: str,
        fixed: float | None = None,
        loose: bool = False,
    ) -> None:
        """Begin at the state as it is, the u₀ of the forces. Collective.

        All effects that take part are given; `divide` divides the cells under those that act, and
        the owner asks, in messages. Functions of time are taken at the time of the path, or at a
        fixed one [s]: then loads grow in proportion to the path, supports and obstacles rest.
        Contacts or loads alone may hold a loose rigid motion: see `Settling`.
        """
        self._settling = Settling(scene) if loose else None
        self._fixed, self.t = fixed, state.t
        self.scene, self.state, self._forces = scene, state, forces
        self._effects, self._divide, self._owner = tuple(effects), divide, owner
        self._control = PathControl()
        self._inversion = Inversion(scene, forces)
        self._cuts, self.share = Cuts(), 1.0
        # Increment per load of the last step that was more than rounding, and of the first.
        self._rate = self._first = 0.0
        self._least = NEGLIGIBLE * scene.mean_cell_size
        self._bound = False
        self.system: System
        self._searching: Newton | None = None  # with a line search, once one was needed
        self._last: tuple[Array, Array, float] | None = None  # increments and length of a step

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return self.system.prolongation.size

    def measure(self) -> Measures:
        """Energies of the current state. Collective."""
        return self.system.energies.measure(self.state)

    def follow(self, t: float) -> None:
        """Bind to the effects that act at t [s], where these are others than before. Collective."""
        at = t if self._fixed is None else self._fixed
        # A drag has no force where nothing moves.
        every: list[Any] = [effect for effect in self._effects if not effect.mass_damping]
        acting = [effect for effect in every if effect.is_windowed and effect.acts(at)]
        if self._bound and [*map(id, acting)] == [*map(id, self.system.acting)]:
            return
        division = self._divide(acting)
        self.close()
        self._inversion.bind(division.flexible)
        drags = [] if self._settling is None else [self._settling.effect]
        known = self.scene, self._forces, self.state, [*every, *drags], acting, division
        self.system = System("static", *known, loose=bool(drags))
        self._bound, self._rate, self._last = True, 0.0, None
        self._before = np.zeros(self.system.prolongation.prescribed.size)  # forces of supports [N]
        self._rows = np.zeros_like(self.state.bodies.rates)  # those on the rows of bodies [N]

    def begin_again(self, t: float) -> None:
        """Divide the cells anew in the state as it is, under what acts at t [s]. Collective."""
        self.close()
        self.t, self._first = self.state.t, 0.0
        self.follow(t)

    def advance(self, end: float) -> StepResult:
        """Go to the load at a time [s], or as far towards it as a cut step gets. Collective.

        `StepError` if there is no equilibrium close to the last one, `InversionError` if cells turn
        inside out, however short the step, `SceneError` if a user's function fails; on every rank.
        """
        t0, before, jumped = self.t, self.measure(), np.inf

        def solved(
            dt: float, t1: float, cuts: int, last: bool
        ) -> tuple[tuple[Solution, float, int], StepError | None]:
            nonlocal jumped
            own = self._settling
            solution = self.solve(t0, t1) if own is None else own.solve(self, t0, t1)
            error, jumped = self._objection(solution, t0, dt, jumped)
            return (solution, t1, cuts), error

        solution, t1, cuts = self._cuts.taken(t0, end, solved)
        work = self._accept(t0, t1, before)
        if jumped > self._least:
            self._rate = jumped / (t1 - t0)
            self._first = self._first or self._rate
        return StepResult(**vars(work), dt=t1 - t0, solution=solution, cuts=cuts)

    def solve(self, t0: float, t1: float, first: Guess | None = None) -> Solution:
        """Find the equilibrium at t₁ from that at t₀; the state is not changed. Collective.

        Loads whose window ends at t₁ act still. The iteration begins at a first guess, by the last
        load step if None. A user's function that fails is a `SceneError` on every rank.
        """
        dt, system = t1 - t0, self.system
        self._set_loads(t1, dt)
        motors = (t0, dt) if self._fixed is None else (self._fixed, 0.0)
        system.begin_step(t0, t1, dt, motors, moves=self._fixed is None)
        rest = self.at_rest
        guesses: tuple[Guess, ...] = (rest if first is None else first,)
        if self._last is not None and first is None:
            d, bodies, before = self._last
            guesses = (rest, Guess(dt / before * d, dt / before * bodies))
        solution = system.newton.solve(guesses)
        if not solution.converged:
            if self._searching is None:
                with default_options(PREFIX, snes_linesearch_type="bt"):
                    self._searching = Newton(system)
            solution = self._searching.solve(guesses[:1]).after(solution)
            if not solution.converged:  # MUMPS may refuse to go on after a singular matrix
                system.newton.destroy()
                self._end_search()
                system.newton = Newton(system)
        return solution

    def _set_loads(self, t: float, dt: float) -> None:
        """Evaluate actions at the end t of a load step of length dt [s]. Collective."""
        at = nextafter(t, -1.0) if self._fixed is None else self._fixed
        self._forces.set_time(at, 0.0)
        self.system.actions.set_time(at, dt)
        if self._fixed is not None:
            self.share = t
            self.system.actions.loads.scale(t)

    def load(self, t: float = 1.0, dt: float = 1.0) -> float:
        """Size of all dead loads at the end t of a load step of length dt [N]. Collective."""
        self._set_loads(t, dt)
        loads = self.system.actions.loads
        of_bodies = np.abs(loads.moments).sum() + np.abs(loads.torques).sum()
        return float(loads.vector.norm(PETSc.NormType.NORM_1) + of_bodies)

    def _end_search(self) -> None:
        """Free its solver. Collective."""
        if self._searching is not None:
            self._searching.destroy()
            self._searching = None

    @property
    def at_rest(self) -> Guess:
        """No increments."""
        return Guess(
            np.zeros(self.system.layout.rows.dofs.size), self.system.prolongation.no_bodies
        )

    @property
    def found(self) -> Guess:
        """Increments of the last solution."""
        d = self.system.d.array_r.copy()
        return Guess(d, self.system.increments.unknowns)

    def distance(self, a: Guess, b: Guess) -> float:
        """Largest difference of two increments [m]. Collective."""
        return self._largest(np.abs(a.increment - b.increment), a.bodies - b.bodies)

    def _largest(self, nodes: Array, bodies: Array) -> float:
        """The largest increment of nodes or bodies [m]. Collective."""
        own = max(float(nodes.max(initial=0.0)), float(np.abs(bodies).max(initial=0.0)))
        return float(self.scene.comm.allreduce(own, op=MPI.MAX))

    def _objection(
        self, solution: Solution, t0: float, dt: float, jumped: float
    ) -> tuple[StepError | None, float]:
        """Why a load step is not taken, if it is not, and its largest increment [m]. Collective."""
        if not solution.converged:
            why = f"Newton's method fails there ({solution.reason}: {solution.course})"
            return self._ended(t0, why, t0 + dt), np.inf
        step = f"{self._owner}: the load step from t = {t0:g} s"
        if (error := inverted(self.scene, self._inversion, step, "", t0 + dt)) is not None:
            return error, np.inf
        d = self.found
        size = self._largest(np.linalg.norm(d.increment.reshape(-1, 3), axis=1), d.bodies)
        known = self._rate > 0 and self._settling is None
        grown = known and size > self._control.jump * self._rate * dt
        if grown and (jumped == np.inf or size > self._control.shrinks * jumped):
            return self._ended(t0, f"the next equilibrium is {size:.3g} m away", t0 + dt), size
        return None, size

    def _ended(self, t: float, why: str, end: float) -> StepError:
        """The path ends: how far it went, and whether at a limit load. Collective."""
        stiffness = self._first / self._rate if self._rate > 0 else 1.0
        limit = stiffness < self._control.soft
        what = (
            f"this is a limit load, where the structure snaps through or buckles: the load per "
            f"displacement has fallen to {stiffness:.2g} of that of the first step"
            if limit
            else "there may be a limit load"
        )
        return StepError(
            f"{self._owner}: no equilibrium follows the one at t = {t:.6g} s: {why}; {what}.",
            overload(self.scene, end)
            or "Prescribe displacements (PrescribedMotion) in place of loads to go beyond, or "
            "simulate the motion with damping. Otherwise take more load steps, or supports that "
            "hold: what contacts alone hold slides off where friction does not bear its loads, and "
            "flies off where they are open at the start; a weak Spring holds it.",
        )

    def _accept(self, t0: float, t1: float, before: Measures) -> Work:
        """Put the last solution into the state, which then is at t₁. Collective.

        Where the time is fixed, that of the state stays. Work is by the trapezoidal rule; loads
        have done what energy has gained beside it, since `before` at the start t₀ of the load step.
        """
        system, increments, self.t = self.system, self.system.increments, t1
        held = system.prolongation.prescribed
        d, own = system.d.array_r, system.body_rows
        f = system.forces_out_of_balance.array_r[held]
        of_supports = system.of_supports(f, 1.0)
        (work,), dissipated = system.taken(0.5 * (self._before + f) @ d[held])
        if len(system.held):
            work += increments.work_of_supports(0.5 * (self._rows + own))
        touches, links = system.actions.touches(), system.told()
        moving = work + sum(touch.work for touch in touches.values())
        self._last = d.copy(), increments.unknowns, t1 - t0
        self._before, self._rows = f, own
        system.move(t1 if self._fixed is None else self.state.t, np.zeros(d.size))
        system.actions.accept()
        system.accept()
        loads = self.measure().energy - before.energy + sum(dissipated.values()) - moving
        dissipated = {kind: energy for kind, energy in dissipated.items() if energy != 0.0}
        return Work(loads, moving, dissipated, *of_supports, np.zeros((2, 3)), touches, *links)

    def close(self) -> None:
        """Free all PETSc objects. Collective."""
        self._end_search()
        if self._bound:
            self.system.destroy()
            self._bound = False


def apply_preload(
    scene: Scene,
    forces: InternalForces,
    state: State,
    start: float,
    divide: Callable[[Sequence[Windowed]], Division],
) -> tuple[Mapping[str, Array], Mapping[str, Array]]:
    """Bring the state into the static equilibrium that the scene asks for, if it does. Collective.

    Effects that act at the start, just after t = 0 [s], take part. Force of each support [N], and
    its moment about the origin [N m], by the name of its set, are returned; none without a preload.
    `SceneError` if supports leave a rigid motion free, `StepError` without an equilibrium.
    """
    found: tuple[Mapping[str, Array], Mapping[str, Array]] = {}, {}
    for preload in scene.named(Preload):
        holds = [*supports_of(scene.acting(start)), *scene.named(Contact)]
        holds = [effect for effect in holds if effect.acts(start)]
        _check(scene, preload, holds, start)
        lasting = [effect for effect in scene.effects if effect.is_lasting]
        paths: list[LoadPath] = []
        spun = preload.centrifugal(scene, lambda paths=paths: paths[0].share)
        locks = [m for m in scene.named(Motor) if m.prescribes and m.acts(start)]
        effects: list[Effect] = [*preload.loads, *lasting, *spun, *holds, *locks]
        path = LoadPath(scene, state, forces, effects, divide, "Preload", fixed=0.0)
        paths.append(path)
        path.follow(0.0)
        if not preload.turns and path.load() == 0.0:
            raise SceneError(
                "Preload: its loads are zero at t = 0, when the statics are, so that there is "
                "nothing to be in equilibrium with. Look at their values and time functions."
            )
        for k in range(1, preload.increments + 1):
            end = k / preload.increments
            while path.t < end:
                result = path.advance(end)
        found = result.reactions, result.reaction_moments
        state.rebuild()
        path.close()
    return found


def _check(scene: Scene, preload: Preload, holds: Sequence[Windowed], start: float) -> None:
    """Refuse statics that have no solution. Collective."""
    if preload.turns and any(effect.is_rigid for effect in scene.effects):
        raise SceneError(
            "Preload: a spin with parts that are Rigid is not supported. Leave the spin out, or "
            "let these parts be flexible."
        )
    idle = [load for load in preload.loads if not load.acts(start)]
    if idle:
        raise SceneError(
            f"Preload: {idle[0].owner} does not act at t = 0, when the statics are. Give it no "
            "time window, or leave it out."
        )
    held = PrescribedDofs(scene, supports_of(holds))
    pressed = any(effect.is_contact for effect in holds)
    if not pressed and (free := free_to_move(scene, held, acting=scene.acting(start))):
        raise SceneError(
            "Preload: the supports that act at the start, and springs, leave a rigid motion "
            f"free, of {free}, so there is no static equilibrium. Add supports or drop the "
            "preload."
        )
