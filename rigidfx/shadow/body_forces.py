"""ρ of the bodies that there are: what their nodes would have to resist by straining."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from rigidfx.base.remembered import Remembered, same
from rigidfx.coupling.mass import Mass
from rigidfx.effects import Rigid
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.shadow.linear_part import LinearPart
from rigidfx.shadow.margin import Margin
from rigidfx.shadow.parts import Parts
from rigidfx.shadow.subjects import Force, FreeBodies
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt
from rigidfx.step.watches.watch import Watch

__all__ = ["BodyForces"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]
Nodes = npt.NDArray[np.int64]

# What PETSc's log calls this part of a run.
_BEARING = PETSc.Log.Event("rigidfxBodyForces")


class BodyForces(Watch):
    """Knows ρ of the present bodies; `destroy` frees the PETSc objects.

    Attributes:
        borne: Bodies in the step that was looked at last, and ρ in their frames [N]; None without.
        dt: Length of the last step [s].
    """

    remembered: ClassVar[Remembered] = same("dt")

    def __init__(self, stepper: Stepper, subjects: FreeBodies) -> None:
        """Compile the forms. Collective.

        Args:
            stepper: Solves the steps.
            subjects: The bodies.
        """
        self._stepper, self._subjects = stepper, subjects
        self._linear = LinearForms(stepper.scene, stepper.forces)
        self.borne: tuple[Parts, Array] | None = None
        self.dt = 0.0
        self._parts: Parts | None = None
        self._mass: Mass | None = None
        self._force: Force | None = None
        self._system: object = None
        self._known: tuple[object, Array] | None = None  # ρ, and K⁺ρ of it
        self._still: tuple[LinearPart, Nodes] | None = None  # for K⁺ρ, and the bodies' rows in it
        self._ended = False

    def bear(self, t: float, dt: float) -> None:
        """Find ρ of the step that has been solved. Collective.

        Args:
            t: Time at its start [s].
            dt: Its length [s].
        """
        with _BEARING:
            self._follow()
            self.borne = None
            if self._parts is not None and self._force is not None:
                self.borne = self._parts, self._force.force(t, dt)

    def _follow(self) -> None:
        """Have the present bodies. Collective."""
        if self._stepper.system is self._system:
            return
        self._system = self._stepper.system
        records, before = self._subjects.records(), self._parts
        if before is None or [*map(id, records)] != [*map(id, before.bodies)]:
            self._drop()
            if records:
                self._have(records)
        if self._force is not None:
            self._force.destroy()
            self._force = None
        if self._parts is not None:
            assert self._mass is not None
            self._force = self._subjects.force(self._parts, self._mass, self._linear)

    def _have(self, records: list[RigidBody]) -> None:
        self._parts = parts = Parts(self._stepper.scene, self._stepper.forces, records)
        self._mass = parts.mass()
        shape = self._linear.shape.x
        shape.array[:] = 0.0
        shape.array[parts.rows.dofs] = parts.shape
        shape.scatter_forward()

    def refresh(self) -> None:
        """See `Watch`."""
        self.borne = None

    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        self.dt = attempt.dt

    # What bodies would strain -------------------------------------------------------------------

    def recovered(self) -> tuple[Array, Ints]:
        """See `Shadows`. Collective."""
        out = np.zeros((self._stepper.scene.owned_nodes, 3))
        if self.borne is None:
            return out, np.empty(0, np.int32)
        parts, force = self.borne
        if self._known is None or self._known[0] is not force:
            self._known = force, parts.unmoved(self._at_rest(parts, force))
        return parts.in_space(self._known[1], self._subjects.present(), out)

    def _at_rest(self, parts: Parts, force: Array) -> Array:
        """K⁺ρ in the bodies' frames, shape (nodes, 3) [m]. Collective."""
        if self._still is None:
            margin = Margin(self._stepper, self._subjects, parts.bodies)
            self._linear.shape.x.array[margin.rows.dofs] = margin.shape
            self._linear.shape.x.scatter_forward()
            self._stepper.forces.set_rate(1.0)
            part = LinearPart(margin, self._linear, np.zeros(margin.rows.nodes.size))
            self._stepper.forces.set_rate(1 / self.dt)
            self._still = part, margin.inside
        part, inside = self._still
        out = part.at_rest(force)[inside]
        if self._ended:
            self._drop()
        return out

    def loaded(self) -> list[tuple[RigidBody, Array]]:
        """Bodies with parts named rigid, and ρ of the last step in space [N]. Collective."""
        if self.borne is None or not self._stepper.scene.named(Rigid):
            return []
        parts, force = self.borne
        return parts.named(force, self._subjects.present())

    def share(self, name: str) -> float | None:
        """See `Shadows`: not told by ρ."""
        return None

    def _drop(self) -> None:
        still = None if self._still is None else self._still[0]
        for item in (self._force, self._mass, still):
            if item is not None:
                item.destroy()
        self._parts = self._mass = self._force = self._still = None

    def destroy(self) -> None:
        """Free the PETSc objects; what bodies would strain may still be asked for. Collective."""
        self._drop()
        self._ended = True
