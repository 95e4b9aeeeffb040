"""What parts named rigid would strain by where more than what holds them bears the loads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.shadow.whole import Whole, small_enough
from rigidfx.step.stepper import Stepper
from rigidfx.step.system.supports import PrescribedDofs

__all__ = ["Recovery"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


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

    def recover(self, u: Array, loaded: Sequence[tuple[RigidBody, Array]], dt: float) -> None:
        """Put in what parts strain in the whole structure, where a shadow knows less. Collective.

        Args:
            u: Displacements of owned nodes, written where parts are, shape (nodes, 3) [m].
            loaded: The parts, and ρ at their nodes in space, shape (nodes, 3) [N].
            dt: Length of the last step [s].
        """
        stepper, parts = self._stepper, [data for data, _ in loaded]
        if not parts or not small_enough(stepper) or not self._more_bears(parts):
            return
        if self._asked != stepper.state.changes:
            whole = self._present(parts)
            whole.take(dt)
            self._known = whole.displaced([force for _, force in loaded])
            whole.leave()
            self._asked = stepper.state.changes
            if self._ended:
                self._free()
        if self._known is not None:
            for data, e in zip(parts, self._known, strict=True):
                u[data.nodes] = e

    def _present(self, parts: Sequence[RigidBody]) -> Whole:
        """The equations of the present division. Collective."""
        system = self._stepper.system
        of = system, system.acting, *parts
        if self._whole is None or [*map(id, of)] != [*map(id, self._of)]:
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

    def _more_bears(self, parts: Sequence[RigidBody]) -> bool:
        """Whether springs, contacts or supports elsewhere take loads as well. Collective."""
        stepper = self._stepper
        active = PrescribedDofs(stepper.scene, stepper.prescribed.active).mask
        elsewhere: Bools = np.any(active.reshape(-1, 3), axis=1)
        for data in parts:
            elsewhere[data.nodes] = False
        here = np.count_nonzero(elsewhere[: stepper.scene.owned_nodes])
        return stepper.system.actions.elastic or bool(stepper.scene.sum(float(here)))
