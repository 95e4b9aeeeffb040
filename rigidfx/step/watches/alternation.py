"""Do most displacements go back and forth from step to step?

A vibration of ω moves on by the phase θ = 2 atan(ωΔt/2) in a step, so that increments d of
successive steps correlate by r = Σ dₙ·M dₙ₊₁ / Σ ½ (dₙ·M dₙ + dₙ₊₁·M dₙ₊₁) = cos θ. Where a period
is shorter than 1.6 Δt, r is below -0.6, and the deflection under a load that begins at once is
twice the static one, then nothing, for ever. All balances hold.
"""

from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.scene.scene import Scene
from rigidfx.step.watches.judge import Attempt, WarnsOnce

BACK = -0.6  # r of a period of 1.6 steps, below which motion counts as alternating
LARGE = 0.25  # of displacements: smaller increments do not matter
FIRST = 4  # steps that are looked at together; twice as many each next time
WORTH_A_WARNING = 1e-6  # of the largest increment so far
NEGLIGIBLE = 1e-10  # of a cell's size: what rounding in displacements may be


class Unresolved(WarnsOnce):
    """Looks at the rest of each accepted solution; warns once.

    Newton's test uses one norm. In a scene of very different stiffnesses this norm is the rounding
    of the stiffest forces, and may be as large as all other forces. The iteration ends there, and
    soft parts keep the error of their last iterate. Relative to its own stiffness and inertia each
    unknown shows this error (`tests/test_unresolved.py`), and the motion of a stiff part as a
    whole, floating between soft ones.
    """

    remembered: ClassVar[Remembered] = WarnsOnce.remembered | same("_moved")

    def __init__(self, scene: Scene) -> None:
        """Begin before the first step. Collective."""
        super().__init__(scene.comm)
        self._least = NEGLIGIBLE * scene.mean_cell_size
        self._moved = 0.0

    def accept(self, attempt: Attempt) -> None:
        """Advise if the rest of a solution is more than rounding."""
        solution = attempt.solution
        self._moved = max(self._moved, solution.moved)
        if not self.waits or solution.left <= max(self._least, WORTH_A_WARNING * self._moved):
            return
        self.say(
            f"In the step from t = {attempt.t:.6g} s rounding in the stiffest parts ended Newton's "
            "iteration before softer ones were in balance: what is left there moves a node by "
            f"about {solution.left / self._moved:.1e} of the largest increment of a step, and "
            "displacements are no better than that. Make what is so stiff Rigid, or let "
            "stiffnesses (materials, springs) differ by less than 1e10."
        )


class Alternation(WarnsOnce):
    """Looks at increments of flexible nodes and of bodies; warns once."""

    remembered: ClassVar[Remembered] = WarnsOnce.remembered

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        """Begin before the first step; u₀ and u₁ of the forces hold its ends. Collective."""
        super().__init__(scene.comm)
        self._scene, self._forces = scene, forces
        self._floor = NEGLIGIBLE * scene.mean_cell_size
        self.bind({})

    def bind(self, flexible: Cells) -> None:
        """Follow the nodes of these cells, from a first step on."""
        scene = self._scene
        cells = np.concatenate([np.empty(0, np.int32), *flexible.values()])
        nodes = np.unique(scene.space.dofmap.list[cells])
        self._nodes = nodes[nodes < scene.owned_nodes]
        self._mass: Array = np.repeat(scene.averaging_mass[self._nodes], 3)
        self.refresh()

    def refresh(self) -> None:
        """Begin a first window of steps."""
        self._before: Array | None = None
        self._sums: Array = np.zeros(3)
        self._now = 0.0, 0.0  # end and length of the last step [s]
        self._steps, self._end = 0, FIRST

    def accept(self, attempt: Attempt) -> None:
        """Add a step's products of increments. Collective in some steps."""
        if not self.waits:
            return
        self._now = attempt.end, attempt.dt
        bodies, own = attempt.increments.start, attempt.increments.unknowns[:, :6]
        u0, u1 = (f.x.array.reshape(-1, 3)[self._nodes] for f in (self._forces.u0, self._forces.u1))
        d = np.concatenate([(u1 - u0).ravel(), own.ravel()]) / attempt.dt
        if self._before is None:  # on all ranks, also on those without nodes
            self._before = d
            return
        once = float(self._comm.rank == 0)  # all ranks know all bodies
        m = np.concatenate([self._mass, np.repeat(once * bodies.of.mass, 6)])
        gone = bodies.r - bodies.of.frozen[:, 0] + own[:, :3]
        way = np.concatenate([u1.ravel(), gone.ravel()])
        of_way = np.concatenate([self._mass, np.repeat(once * bodies.of.mass, 3)])
        both = m @ (d * self._before), 0.5 * (m @ (d * d + self._before**2))
        size = LARGE**2 * of_way @ way**2 + of_way.sum() * self._floor**2
        self._sums += [*both, size / attempt.dt**2]
        self._before = d
        self._steps += 1
        if self._steps == self._end:
            self._judge()
            self._sums[:], self._end = 0.0, 2 * self._end

    def end(self) -> None:
        """Judge a run of few steps as a whole; one pair may be a rebound. Collective."""
        if self.waits and self._end == FIRST and 2 * self._steps >= FIRST:
            self._judge()

    def _judge(self) -> None:
        """Warn where increments alternate. Collective."""
        (t, dt), (product, square, least) = self._now, self._scene.sum(self._sums)
        if not square > least or product >= BACK * square:
            return
        self.say(
            f"Up to t = {t:.6g} s most of the motion goes back and forth from "
            f"step to step (increments of successive steps correlate by {product / square:.2f}): "
            f"its periods are two or three steps of Δt = {dt:.3g} s, or less, and it is no "
            "image of the real motion. Take a tenth of the period of interest (rf.periods), or "
            "StepControl. Where only the deflection under a slow load is of interest, let that "
            "grow over some steps (rf.Table), or take rf.static."
        )
