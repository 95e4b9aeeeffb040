"""Whether rounding in stiff parts has ended Newton's iteration before soft parts were in balance.

Newton's test uses one norm. In a scene of very different stiffnesses this norm is the rounding of
the stiffest forces, and may be as large as all other forces. The iteration ends there, and soft
parts keep the error of their last iterate. Relative to its own stiffness and inertia each unknown
shows this error. With parts in a ratio of stiffness of 1e10, 1e12 and 1e14 it is 5e-10, 3e-8 and
6e-4 of a step's increment, and displacements had errors of 2e-9, 2e-9 and 5e-5
(`tests/test_unresolved.py`). For the motion of a stiff part as a whole, floating between soft ones,
`stiff_parts` shows it: at 1e12 it is 1e-6 to 5e-6 of an increment, and displacements have errors of
4e-8 to 3e-6 with Δt = 0.05 s, and of 1e-2 with 0.2 s.
"""

from __future__ import annotations

from typing import ClassVar

from rigidfx.base.remembered import Remembered, same
from rigidfx.scene.scene import Scene
from rigidfx.step.watches.judge import Attempt
from rigidfx.step.watches.watch import WarnsOnce

__all__ = ["NEGLIGIBLE", "Unresolved"]

WORTH_A_WARNING = 1e-6  # of the largest increment so far
NEGLIGIBLE = 1e-10  # of a cell's size: what rounding in displacements may be


class Unresolved(WarnsOnce):
    """Looks at the rest of each accepted solution; warns once."""

    remembered: ClassVar[Remembered] = WarnsOnce.remembered | same("_moved")

    def __init__(self, scene: Scene) -> None:
        """Begin before the first step. Collective.

        Args:
            scene: The problem.
        """
        super().__init__(scene.comm)
        self._least = NEGLIGIBLE * scene.mean_cell_size
        self._moved = 0.0

    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        solution = attempt.solution
        self._moved = max(self._moved, solution.moved)
        if not self.waits or solution.left <= max(self._least, WORTH_A_WARNING * self._moved):
            return
        self.say(
            f"In the step from t = {attempt.t:.6g} s rounding in the stiffest parts ended Newton's "
            "iteration before softer ones were in balance: what is left there moves a node by "
            f"about {solution.left / self._moved:.1e} of the largest increment of a step, and "
            "displacements are no better than that. Make what is so stiff Rigid, or let "
            "stiffnesses (materials, springs) differ by less than 1e10.",
        )
