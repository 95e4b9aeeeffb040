"""What parts named rigid would strain by where their shadows know too little.

That is where more than what holds them bears the loads, and where they would bend by so much that a
linear response does not balance the forces on them: stresses of a bar whose tip went 4 % of its
length were 4 % off, by turns alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.shadow.whole import Whole, small_enough
from rigidfx.step.stepper import Stepper
from rigidfx.step.system.supports import PrescribedDofs

__all__ = ["Carried", "Recovery"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Int32s = npt.NDArray[np.int32]


BENDS = 0.02  # part of its length that a part may move within itself by a linear response


class Carried(NamedTuple):
    """What forces on rigid parts would move there.

    Attributes:
        u: Displacements of the owned nodes in space, zero outside, shape (nodes, 3) [m].
        cells: Owned cells that it is of.
        balanced: Those of them whose forces balance where it leads to; it is a linear response, the
            first derivative of a motion, in the others.
    """

    u: Array
    cells: Int32s
    balanced: Int32s

    def among(self, count: int) -> tuple[Bools, Bools]:
        """Which of so many owned cells it is of, and of which as a linear response."""
        cells, linear = np.zeros((2, count), dtype=bool)
        cells[self.cells] = linear[self.cells] = True
        linear[self.balanced] = False
        return cells, linear


class Recovery:
    """Solves the whole structure for them, once for each state of the run that is asked for.

    Its equations and factors serve for as long as the division is the same, and what acts on it;
    factors that have become too old are found out by what a solve leaves.
    """

    def __init__(self, stepper: Stepper) -> None:
        """Nothing is known yet.

        Args:
            stepper: Solves the steps.
        """
        self._stepper = stepper
        self._asked = -1  # the state that is known, by how often it had been written into
        self._known: list[Array] | None = None
        self._whole: Whole | None = None
        self._of: tuple[object, ...] = ()  # what that is bound to
        self._ended = False

    def recover(self, u: Array, loaded: Sequence[tuple[RigidBody, Array]], dt: float) -> Int32s:
        """Put in what parts strain in the whole structure, where a shadow knows less. Collective.

        Args:
            u: Displacements of owned nodes, written where parts are, shape (nodes, 3) [m].
            loaded: The parts, and ρ at their nodes in space, shape (nodes, 3) [N].
            dt: Length of the last step [s].

        Returns:
            Owned cells of these parts; none where they are as they were.
        """
        stepper, parts = self._stepper, [data for data, _ in loaded]
        if not parts or not small_enough(stepper):
            return np.empty(0, np.int32)
        if not (self._bends(u, parts) or self._more_bears(parts)):
            return np.empty(0, np.int32)
        if self._asked != stepper.state.changes:
            whole = self._present(parts)
            whole.take(dt)
            try:
                self._known = whole.displaced([force for _, force in loaded])
            finally:
                whole.leave()
            self._asked = stepper.state.changes
            if self._ended:
                self._free()
        if self._known is None:
            return np.empty(0, np.int32)
        for data, e in zip(parts, self._known, strict=True):
            u[data.nodes] = e
        return np.concatenate([data.cells for data in parts])

    def _present(self, parts: Sequence[RigidBody]) -> Whole:
        """The equations of the present division. Collective."""
        system = self._stepper.system
        of = system, system.acting, *parts
        forgetful = bool(self._stepper.state.notes)  # what effects remember goes on meanwhile
        if self._whole is None or forgetful or [*map(id, of)] != [*map(id, self._of)]:
            self._free()
            self._whole, self._of = Whole(self._stepper, parts), of
        return self._whole

    def _free(self) -> None:
        """Free the PETSc objects. Collective."""
        if self._whole is not None:
            self._whole.destroy()
        self._whole, self._of = None, ()

    def destroy(self) -> None:
        """Free the PETSc objects; what is asked for later is made for that alone. Collective."""
        self._free()
        self._ended = True

    def _bends(self, u: Array, parts: Sequence[RigidBody]) -> bool:
        """Whether any of the parts moves far within itself by a linear response. Collective."""
        far = (np.abs(u[data.nodes]).max(initial=0.0) > BENDS * data.length for data in parts)
        return bool(self._stepper.scene.sum(float(sum(far))))

    def _more_bears(self, parts: Sequence[RigidBody]) -> bool:
        """Whether springs, contacts or supports elsewhere take loads as well. Collective."""
        stepper = self._stepper
        active = PrescribedDofs(stepper.scene, stepper.prescribed.active).mask
        elsewhere: Bools = np.any(active.reshape(-1, 3), axis=1)
        for data in parts:
            elsewhere[data.nodes] = False
        here = np.count_nonzero(elsewhere[: stepper.scene.owned_nodes])
        return bool(stepper.system.actions.elastic or stepper.scene.sum(float(here)))
