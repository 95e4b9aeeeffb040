"""What has shadows: bodies that move freely, and parts named rigid that supports hold.

A part that supports hold is no body of its own: each of its nodes is driven, and has an equation of
its own in a step. What is out of balance there is what a support would have to exert at the node,
and stiffness does: as on a body, but for the nodes that supports hold in truth. The part strains
between these and the forces on the rest of it; no rigid motion of it is left.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from rigidfx.coupling.dof_layout import nodes_of
from rigidfx.coupling.mass import Mass
from rigidfx.effects import Rigid
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, BodyMotion, RigidBody
from rigidfx.scene.scene import Scene
from rigidfx.shadow.parts import Parts, watched
from rigidfx.shadow.withheld import Withheld
from rigidfx.step.stepper import Stepper
from rigidfx.step.system.supports import PrescribedDofs
from rigidfx.step.watches.judge import Attempt

__all__ = ["Force", "FreeBodies", "HeldParts", "Subjects"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


class Force(Protocol):
    """The force that rigidity takes over, at the nodes of some subjects."""

    def force(self, t: float, dt: float, little: float = 0.0) -> Array:
        """ρ of the step that has been solved last: see `Withheld.force`. Collective."""
        ...

    def exact(self, force: Array) -> Array:
        """ρ of the last step, where `force` took it for another. Collective."""
        ...

    def rise(self, t: float, dt: float, alarming: Callable[[float], bool]) -> Array | None:
        """What loads will change of ρ in a step: see `Withheld.rise`. Collective."""
        ...

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        ...


class Subjects(Protocol):
    """Rigid parts of one kind that have shadows.

    Attributes:
        free: Whether they move as rigid bodies do under the forces on them.
    """

    free: bool

    @property
    def last(self) -> Bodies:
        """They and others at the end of the last accepted step, or as shadows took them over."""
        ...

    def records(self) -> list[RigidBody]:
        """Their data. Collective."""
        ...

    def present(self) -> Bodies:
        """They and others as they are now. Collective."""
        ...

    def held(self) -> Bools:
        """For each owned node, which components are held as they would strain, too."""
        ...

    def force(self, parts: Parts, mass: Mass, linear: LinearForms) -> Force:
        """What forces on them are found by. Collective.

        Args:
            parts: Their nodes.
            mass: Mass operator of these.
            linear: Forms, whose shape is theirs.
        """
        ...

    def follow(self) -> None:
        """Take note that shadows have taken the present ones over."""
        ...

    def accept(self, attempt: Attempt) -> None:
        """Take note that an attempt becomes a step."""
        ...


class FreeBodies:
    """The bodies that move freely.

    Attributes:
        free: As of `Subjects`.
        last: As of `Subjects`.
    """

    free = True

    def __init__(self, stepper: Stepper, in_pieces: frozenset[str]) -> None:
        """Take them from the stepper's state.

        Args:
            stepper: Solves the steps.
            in_pieces: Parts named rigid whose cells are not connected through facets: nothing
                tells what goes from piece to piece, and their bodies have no shadow.
        """
        self._stepper, self._in_pieces = stepper, in_pieces
        self.last = Bodies.of_each(())

    def records(self) -> list[RigidBody]:
        """See `Subjects`."""
        return watched(self._stepper.state.bodies.of.records, self._in_pieces)

    def present(self) -> Bodies:
        """See `Subjects`."""
        return self._stepper.state.bodies

    def held(self) -> Bools:
        """See `Subjects`."""
        return self._stepper.prescribed.mask.reshape(-1, 3)

    def force(self, parts: Parts, mass: Mass, linear: LinearForms) -> Force:
        """See `Subjects`."""
        return Withheld(self._stepper, parts, mass, linear)

    def follow(self) -> None:
        """See `Subjects`."""
        self.last = self._stepper.state.bodies

    def accept(self, attempt: Attempt) -> None:
        """See `Subjects`."""
        self.last = attempt.increments.end


class HeldParts:
    """The parts named rigid that supports hold, in the shape and at the place that they have.

    Attributes:
        free: As of `Subjects`.
    """

    free = False

    def __init__(self, stepper: Stepper, in_pieces: frozenset[str]) -> None:
        """Take them from the stepper's state. Arguments as of `FreeBodies`."""
        self._stepper, self._in_pieces = stepper, in_pieces
        self._known: dict[int, RigidBody] = {}  # by their numbers

    def records(self) -> list[RigidBody]:
        """See `Subjects`."""
        clamped, named = self._stepper.state.clamped, self._stepper.scene.named(Rigid)
        wanted = {n: named[n - 1].name for n in clamped if named[n - 1].name not in self._in_pieces}
        self._known = {
            number: self._known.get(number) or self._record(name, number, clamped[number])
            for number, name in wanted.items()
        }
        return list(self._known.values())

    def _record(self, name: str, number: int, cells: npt.NDArray[np.int32]) -> RigidBody:
        """A part as a body that is frozen where it is. Collective."""
        stepper = self._stepper
        scene, state, forces = stepper.scene, stepper.state, stepper.forces
        inside = nodes_of(scene, forces.cells(cells))[: scene.owned_nodes]
        nodes = np.flatnonzero(inside).astype(np.int32)
        x, m = state.positions(nodes.astype(np.int64)), scene.nodal_mass[nodes]
        sums = scene.sum(np.r_[m.sum(), m @ x, cells.size])
        centre = sums[1:4] / sums[0]
        spread = np.asarray(scene.sum((x - centre).T @ (m[:, None] * (x - centre))))
        return RigidBody(
            name=name,
            cells=cells,
            nodes=nodes,
            offsets=x - centre,
            mass=float(sums[0]),
            inertia=np.trace(spread) * np.eye(3) - spread,
            origin=centre,
            number=number,
            size=int(sums[4]),
            named=(name,),
        )

    @property
    def last(self) -> Bodies:
        """See `Subjects`."""
        return self.present()

    def present(self) -> Bodies:
        """See `Subjects`: at the places of their nodes."""
        return Bodies.of_each(Body(data, self._motion(data)) for data in self._known.values())

    def _motion(self, data: RigidBody) -> BodyMotion:
        scene, state = self._stepper.scene, self._stepper.state
        r, R = fitted(scene, data, state.positions(data.nodes.astype(np.int64)))
        return BodyMotion(r, R, np.zeros(3), np.zeros(3))

    def held(self) -> Bools:
        """See `Subjects`: of these parts, what supports hold in truth."""
        stepper = self._stepper
        held = stepper.prescribed.mask.reshape(-1, 3).copy()
        truly = PrescribedDofs(stepper.scene, stepper.prescribed.active).mask.reshape(-1, 3)
        for data in self._known.values():
            held[data.nodes] = truly[data.nodes]
        return held

    def force(self, parts: Parts, mass: Mass, linear: LinearForms) -> Force:
        """See `Subjects`."""
        return Borne(self._stepper, parts)

    def follow(self) -> None:
        """See `Subjects`."""

    def accept(self, attempt: Attempt) -> None:
        """See `Subjects`."""


class Borne:
    """The force on the nodes of parts that supports hold."""

    def __init__(self, stepper: Stepper, parts: Parts) -> None:
        """Find the nodes' rows.

        Args:
            stepper: Solves the steps; the division is that in which supports hold the parts.
            parts: The parts.
        """
        self._stepper, self._parts = stepper, parts
        self._rows = stepper.system.layout.rows.positions(parts.rows.nodes)

    def force(self, t: float, dt: float, little: float = 0.0) -> Array:
        """See `Force`."""
        equilibrium, parts = self._stepper.system.equilibrium, self._parts
        moved = equilibrium.start + 0.5 * equilibrium.d.array_r
        x = parts.rows.X + moved.reshape(-1, 3)[self._rows]
        scene = self._stepper.scene
        fits = [fitted(scene, data, x[at]) for data, at in zip(parts.bodies, parts.at, strict=True)]
        f = equilibrium.forces_out_of_balance.array_r.reshape(-1, 3)[self._rows]
        return parts.turned(-f, np.array([R for _, R in fits]))

    def exact(self, force: Array) -> Array:
        """See `Force`."""
        return force

    def rise(self, t: float, dt: float, alarming: Callable[[float], bool]) -> Array | None:
        """Of no use: such parts do not wake."""
        return None

    def destroy(self) -> None:
        """There is nothing to free."""


def fitted(scene: Scene, data: RigidBody, x: Array) -> tuple[Array, Array]:
    """Centre [m] and rotation of a body that fit places of its nodes best, by masses. Collective.

    Args:
        scene: The problem.
        data: The body.
        x: Places of its owned nodes, shape (nodes, 3) [m].
    """
    m, V = scene.nodal_mass[data.nodes], data.offsets
    mx = m[:, None] * (x - data.origin)
    sums = np.asarray(scene.sum(np.concatenate([[mx.sum(axis=0)], mx.T @ V])))
    W, _, Vt = np.linalg.svd(sums[1:])
    R = W @ np.diag([1.0, 1.0, np.linalg.det(W @ Vt)]) @ Vt
    return data.origin + sums[0] / data.mass, R
