"""How loose parts come to rest in a load step: under a drag that follows them and fades.

Contacts or loads alone hold a chain, a pendulum or a block on a floor, and the tangent of statics
is singular where they do not yet. The drag of `StepDrag` makes it regular. Each solve draws the
parts to the last solution, and the next one has a third of the drag. It ends where the drag is
nothing against the loads. Where a solve fails the drag is taken three times as large.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rigidfx.effects import Contact
from rigidfx.effects.inertia import StepDrag, StepDragForces
from rigidfx.scene.scene import Scene
from rigidfx.step.newton.first_guess import Guess
from rigidfx.step.newton.solution import Solution
from rigidfx.step.system.statics import StaticSystem

__all__ = ["Settling"]


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
        self.effect = StepDrag(self._take)
        self._size = float(np.linalg.norm(np.ptp([*scene.parts.lower, *scene.parts.upper], axis=0)))
        self._mass = float(scene.sum(scene.averaging_mass[: scene.owned_nodes].sum()))
        stiffness = max(material.stiffness for material, _ in scene.materials) * self._size
        self._least = float(np.cbrt(np.finfo(np.float64).eps)) ** 2 * stiffness / self._mass
        self._s, self._near = self._control.first, self._control.near
        if scene.named(Contact):
            self._near *= scene.mean_cell_size / self._size

    def _take(self, forces: StepDragForces) -> None:
        self._forces = forces

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
                solution = system.solve(t0, t1, first).after(solution)
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
