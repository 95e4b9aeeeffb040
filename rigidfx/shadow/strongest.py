"""What a rigid part would give way by in the whole structure, and not beside its neighbours alone.

It is told once, so that it is worth the factors of all of the structure as it is then.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.shadow.parts import Parts
from rigidfx.shadow.whole import Whole, small_enough
from rigidfx.step.stepper import Stepper

__all__ = ["Strongest"]

Array = npt.NDArray[np.float64]


class Strongest:
    """The forces by which parts named rigid withheld most so far."""

    def __init__(self) -> None:
        """Nothing is withheld."""
        self._known: dict[str, tuple[float, RigidBody, Array]] = {}

    def note(self, parts: Parts, withheld: Mapping[str, float], force: Array) -> None:
        """Take note of a step.

        Args:
            parts: The bodies.
            withheld: ½ ρᵀK⁺ρ, by the names of parts named rigid that are in them [J].
            force: ρ at the nodes of the rows, shape (nodes, 3) [N].
        """
        for data, at in zip(parts.bodies, parts.at, strict=True):
            for name in data.named:
                if withheld[name] > (self._known[name][0] if name in self._known else 0.0):
                    self._known[name] = withheld[name], data, force[at]

    def share(self, name: str, stepper: Stepper, present: Bodies, dt: float) -> float | None:
        """What part of its energy a part would withhold in the whole structure. Collective.

        Args:
            name: The part.
            stepper: Solves the steps.
            present: Bodies as they are now.
            dt: Length of the last step [s].

        Returns:
            The part; None where nothing is known of it, and where the structure is too large.
        """
        if not small_enough(stepper):
            return None
        now = {id(body.data): body.motion.R for body in present}
        if name not in self._known or id(self._known[name][1]) not in now:
            return None
        energy, data, force = self._known[name]
        whole = Whole(stepper, (data,))
        whole.take(dt)
        try:
            told = whole.energy([force @ now[id(data)].T])
        finally:
            whole.leave()
            whole.destroy()
        # What buckles has no stiffness that tells.
        return told / energy if told > 0 and np.isfinite(told) else None
