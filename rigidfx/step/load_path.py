"""A path of load steps: each is solved, looked at, cut where it fails, and accepted.

A load step is cut where Newton's method fails, where it turns cells inside out, and where it jumps:
where its increment is several times that of the step before and does not shrink as the step does.
Such a jump, or a failure that no cut mends, is a limit load.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigidfx.base.errors import InversionError, StepError
from rigidfx.base.instants import longer
from rigidfx.effects import Contact, Effect, Structure, Windowed
from rigidfx.effects.inertia import StaticForces, StepDrag
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.inversion import Inversion
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.energies import Measures
from rigidfx.step.newton.first_guess import Guess
from rigidfx.step.newton.newton import Solution
from rigidfx.step.system.division import Division
from rigidfx.step.system.statics import StaticSystem
from rigidfx.step.system.system import StepResult
from rigidfx.step.watches.alternation import NEGLIGIBLE
from rigidfx.step.watches.judge import INVERTED, course, overload, remedy


@dataclass(frozen=True)
class SettlingControl:
    """How the drag is chosen; s is over the load per mass and size of the whole.

    Attributes:
        first: s of the first load step: it moves parts by a thousandth of their size or less.
        least: Least s, which keeps motions regular that nothing holds, but that no load drives.
        change: Factor of s from solve to solve.
        near: Motion of a solve, over the size of the whole, up to which the next one has less drag;
            with contacts over that of a cell, as surfaces are not to pass through each other.
        far: Motion above which a solve is repeated with more drag: it may lead past an equilibrium.
        rest: Drag over the loads that counts as nothing.
        drifts: Drag over the loads that does not fade, along a motion that nothing holds, which
            counts as nothing: contacts of meshes have such forces across.
        solves: Solves of a load step before it is said to have no end.
    """

    first: float = 1000.0
    least: float = 1e-4
    change: float = 3.0
    near: float = 0.1
    far: float = 0.3
    rest: float = 1e-11
    drifts: float = 1e-6
    solves: int = 100


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

    def __init__(self, scene: Scene, control: SettlingControl | None = None) -> None:
        """Measure the whole. Collective.

        Args:
            scene: The problem.
            control: How the drag is chosen.
        """
        self._control = SettlingControl() if control is None else control
        self.effect = StaticForces(self._bind)
        self._size = float(np.linalg.norm(np.ptp([*scene.parts.lower, *scene.parts.upper], axis=0)))
        self._mass = float(scene.sum(scene.averaging_mass[: scene.owned_nodes].sum()))
        stiffness = max(material.stiffness for material, _ in scene.materials) * self._size
        self._least = float(np.cbrt(np.finfo(np.float64).eps)) ** 2 * stiffness / self._mass
        self._s, self._near = self._control.first, self._control.near
        if scene.named(Contact):
            self._near *= scene.mean_cell_size / self._size

    def _bind(self, structure: Structure) -> StepDrag:
        self._forces = StepDrag(structure)
        return self._forces

    def solve(self, system: StaticSystem, t0: float, t1: float) -> Solution:
        """Find an equilibrium at t₁ from that at t₀; the state is not changed. Collective.

        Args:
            system: The equations, with the drag.
            t0: Start of the load step [s].
            t1: Its end [s].

        Returns:
            The last solve, with the cost of all; not converged if parts do not come to rest.
        """
        control, forces = self._control, self._forces
        load = system.load(t1, t1 - t0)
        unit = max(load / (self._mass * self._size), self._least)
        force = unit * self._mass * self._size
        last, pose = system.at_rest
        forces.draw_to(last.increment, pose)
        first: Guess | None = None
        left = np.inf  # drag over loads
        solution: Solution | None = None
        for _ in range(control.solves):
            forces.rate = self._s * unit
            system.take_drag(forces.rate)
            with np.errstate(over="ignore", invalid="ignore"):  # it may run away, and fails then
                solution = system.solve_load(t0, t1, first).after(solution)
            found, pose = system.found
            moved = system.distance(found, last) / self._size
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
    """When a load step is cut.

    Attributes:
        cuts: How often a load step is halved before the path ends.
        jump: Growth of the largest increment per load, from step to step, that is looked at more
            closely. Before a limit point, where u_c - u grows with √(t_c - t), it is at most 2.5.
        shrinks: A continuous path has at most this part of an increment in half the load step.
        soft: Ratio of the load per displacement to that of the first step below which an end of
            the path is told as a limit load.
    """

    cuts: int = 8
    jump: float = 4.0
    shrinks: float = 0.8
    soft: float = 0.5


class LoadPath:
    """Statics of a scene, load step by load step; `close` frees it.

    Attributes:
        scene: The problem.
        state: Its state, whose time is that of the loads.
        indicator: None: nothing is measured to become rigid.
        system: The equations; those of the division and of the effects that act.
        t: Where the path is [s].
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
        control: PathControl | None = None,
        loose: bool = False,
    ) -> None:
        """Begin at the state as it is. Collective.

        Args:
            scene: The problem.
            state: Where the path begins.
            forces: Internal forces, whose u₀ is the state's displacement.
            effects: All effects that take part.
            divide: Divides the cells under the effects that act.
            owner: Who asks, for messages.
            fixed: Time at which functions of time are taken [s]; that of the path if None. See
                `StaticSystem`.
            control: When a load step is cut.
            loose: Whether contacts or loads alone hold a rigid motion: see `Settling`.
        """
        self._settling = Settling(scene) if loose else None
        self._fixed, self.t = fixed, state.t
        self.scene, self.state, self._forces = scene, state, forces
        self._effects, self._divide, self._owner = tuple(effects), divide, owner
        self._control = PathControl() if control is None else control
        self._inversion = Inversion(scene, forces)
        self._trial = self._whole = np.inf
        # Increment per load of the last step that was more than rounding, and of the first.
        self._rate = self._first = 0.0
        self._least = NEGLIGIBLE * scene.mean_cell_size
        self._bound = False
        self.system: StaticSystem

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return self.system.unknowns

    def measure(self) -> Measures:
        """Energies of the current state. Collective."""
        return self.system.energies.measure(self.state)

    def follow(self, t: float) -> None:
        """Bind to the effects that act at t [s], where these are others than before. Collective."""
        every: Sequence[Any] = self._effects
        windowed = (e for e in every if e.is_windowed and not e.mass_damping)
        acting = [
            effect for effect in windowed if effect.acts(t if self._fixed is None else self._fixed)
        ]
        if self._bound and [*map(id, acting)] == [*map(id, self.system.acting)]:
            return
        division = self._divide(acting)
        self.close()
        self._inversion.bind(division.flexible)
        drags = [] if self._settling is None else [self._settling.effect]
        self.system = StaticSystem(
            self.scene,
            self._forces,
            self.state,
            [*self._effects, *drags],
            acting,
            division,
            self._fixed,
            bool(drags),
        )
        self._bound, self._rate = True, 0.0

    def advance(self, end: float) -> StepResult:
        """Go to a load, or as far towards it as a cut step gets. Collective.

        Args:
            end: Time of the load [s].

        Raises:
            SceneError: On every rank, if a user's function fails on any.
            StepError: If there is no equilibrium close to the last one.
            InversionError: If cells turn inside out, however short the step.
        """
        t0 = self.t
        left = end - t0
        if self._trial == np.inf:
            self._whole = left
        before, cuts, jumped = self.measure(), 0, np.inf
        while True:
            dt = self._trial if longer(left, self._trial) else left
            t1 = end if dt == left else t0 + dt
            if self._settling is None:
                solution = self.system.solve_load(t0, t1)
            else:
                solution = self._settling.solve(self.system, t0, t1)
            error, size = self._objection(solution, t0, dt, jumped)
            if error is None:
                self._trial = np.inf if dt == left and cuts == 0 else 2 * dt
                return self._accept(solution, t0, t1, cuts, before, size)
            if not longer(dt, self._whole / 2**self._control.cuts):
                raise error
            jumped = size
            cuts += 1
            self._trial = dt / 2

    def _objection(
        self, solution: Solution, t0: float, dt: float, jumped: float
    ) -> tuple[StepError | None, float]:
        """Why a load step is not taken, if it is not, and its largest increment [m]. Collective."""
        if not solution.converged:
            why = f"Newton's method fails there ({solution.reason}: {course(solution)})"
            return self._ended(t0, why, t0 + dt), np.inf
        if (turned := self._inversion.find()) is not None:
            found = f"{self._owner}: the load step from t = {t0:g} s turns cells inside out: "
            advice = f"{overload(self.scene, t0 + dt)} {remedy(self.scene)}".strip()
            return InversionError(f"{found}{turned}{INVERTED}", advice), np.inf
        size = self.system.size
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

    def _accept(
        self, solution: Solution, t0: float, t1: float, cuts: int, before: Measures, size: float
    ) -> StepResult:
        """Accept the last solution. Collective."""
        work = self.system.accept_load(t0, t1, before)
        self.t = t1
        if size > self._least:
            self._rate = size / (t1 - t0)
            self._first = self._first or self._rate
        return StepResult(**vars(work), dt=t1 - t0, solution=solution, cuts=cuts)

    def close(self) -> None:
        """Free all PETSc objects. Collective."""
        if self._bound:
            self.system.destroy()
            self._bound = False
