"""ρ of the present bodies: forces at their nodes that would strain them."""

from __future__ import annotations

from typing import ClassVar

from petsc4py import PETSc

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.coupling.mass import Mass
from rigidfx.error.forces.parts import Parts, watched
from rigidfx.error.forces.withheld import Withheld
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt, Watch

__all__ = ["BodyForces"]


# What PETSc's log calls this part of a run.
_BEARING = PETSc.Log.Event("rigidfxBodyForces")


class BodyForces(Watch):
    """Knows ρ of the present bodies; `destroy` frees the PETSc objects.

    Attributes:
        borne: Bodies in the step that was looked at last, and ρ in their frames [N]; None without.
        dt: Length of the last step [s].
    """

    remembered: ClassVar[Remembered] = same("dt")

    def __init__(self, stepper: Stepper, in_pieces: frozenset[str]) -> None:
        """Compile the forms. Collective.

        Args:
            stepper: Solves the steps.
            in_pieces: Parts named rigid whose cells are not connected through facets: forces from
                piece to piece are unknown, and ρ of their bodies is not known.
        """
        self._stepper, self._in_pieces = stepper, in_pieces
        self._linear = LinearForms(stepper.scene, stepper.forces)
        self.borne: tuple[Parts, Array] | None = None
        self.dt = 0.0
        self._parts: Parts | None = None
        self._mass: Mass | None = None
        self._force: Withheld | None = None
        self._system: object = None

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
        """Bind the present bodies. Collective."""
        if self._stepper.system is self._system:
            return
        self._system = self._stepper.system
        records, before = (
            watched(self._stepper.state.bodies.of.records, self._in_pieces),
            self._parts,
        )
        if before is None or [*map(id, records)] != [*map(id, before.bodies)]:
            self._drop()
            if records:
                self._have(records)
        if self._force is not None:
            self._force.destroy()
            self._force = None
        if self._parts is not None:
            assert self._mass is not None
            self._force = Withheld(self._stepper, self._parts, self._mass, self._linear)

    def _have(self, records: list[RigidBody]) -> None:
        self._parts = parts = Parts(self._stepper.scene, self._stepper.forces, records)
        self._mass = parts.mass()
        shape = self._linear.shape.x
        shape.array[:] = 0.0
        shape.array[parts.rows.dofs] = parts.shape
        shape.scatter_forward()

    def forget(self) -> None:
        """Tell no forces of the present bodies any more. Collective."""
        self._drop()
        self._system, self.borne = self._stepper.system, None

    def refresh(self) -> None:
        """See `Watch`."""
        self.borne = None

    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        self.dt = attempt.dt

    def named(self) -> list[tuple[RigidBody, Array]]:
        """Bodies with parts named rigid, and ρ in their frames, shape (nodes, 3) [N]."""
        if self.borne is None:
            return []
        parts, force = self.borne
        return [(b, force[at]) for b, at in zip(parts.bodies, parts.at, strict=True) if b.named]

    def _drop(self) -> None:
        for item in (self._force, self._mass):
            if item is not None:
                item.destroy()
        self._parts = self._mass = self._force = None

    def destroy(self) -> None:
        """Free the PETSc objects; the last forces may still be asked for. Collective."""
        self._drop()
