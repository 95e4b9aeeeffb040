"""Parts named rigid that supports hold, and the forces on their nodes.

A part that supports hold is no body of its own: each of its nodes is driven, and has an equation of
its own in a step. A support would have to exert the imbalance at the node,
and stiffness does: as on a body, but for the nodes that supports hold in truth. The part strains
between these and the forces on the rest of it; no rigid motion of it is left.
"""

import numpy as np

from rigidfx.base.types import Array, Bools, Indices
from rigidfx.coupling.dof_layout import nodes_of
from rigidfx.effects import Rigid
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, BodyMotion, RigidBody
from rigidfx.mechanics.rigid_motions import best_motion
from rigidfx.step.equations.supports import PrescribedDofs
from rigidfx.step.stepper import Stepper
from rigidfx.step.system.system import System
from rigidfx.step.watches.judge import Attempt, Watch


class HeldParts(Watch):
    """The parts named rigid that supports hold, in the shape and at the place that they have."""

    def __init__(self, stepper: Stepper, in_pieces: frozenset[str]) -> None:
        """Read them from the stepper's state.

        Of parts named rigid that are `in_pieces`, whose cells are not connected through facets,
        forces from piece to piece are unknown.
        """
        self._stepper, self._in_pieces = stepper, in_pieces
        self._known: dict[int, RigidBody] = {}  # by their numbers
        self._stepped: System | None = None  # what has made the last step
        self._borne: dict[int, Array] | None = None  # forces in it, once they were asked for

    def records(self) -> list[RigidBody]:
        """Their data. Collective."""
        clamped, named = self._stepper.state.clamped, self._stepper.scene.named(Rigid)
        wanted = {n: named[n - 1].name for n in clamped if named[n - 1].name not in self._in_pieces}
        self._known = {
            number: self._known.get(number) or self._record(name, number, clamped[number])
            for number, name in wanted.items()
        }
        return list(self._known.values())

    def _record(self, name: str, number: int, cells: Indices) -> RigidBody:
        """A part as a body that is frozen where it is. Collective."""
        stepper = self._stepper
        scene, state, forces = stepper.scene, stepper.state, stepper.forces
        inside = nodes_of(scene, forces.cells(cells))[: scene.owned_nodes]
        nodes = np.flatnonzero(inside).astype(np.int32)
        x, m = state.positions(nodes.astype(np.int64)), scene.averaging_mass[nodes]
        sums = scene.sum(np.r_[m.sum(), m @ x, cells.size])
        centre = sums[1:4] / sums[0]
        spread = np.asarray(scene.sum((x - centre).T @ (m[:, None] * (x - centre))))
        return RigidBody(
            name=name,
            cells=cells,
            nodes=nodes,
            offsets=x - centre,
            displacement=x - state.X[nodes],
            mass=float(sums[0]),
            inertia=np.trace(spread) * np.eye(3) - spread,
            origin=centre,
            number=number,
            size=int(sums[4]),
            named=(name,),
        )

    def present(self) -> Bodies:
        """They at the places of their nodes. Collective."""
        state, rest, out = self._stepper.state, np.zeros(3), []
        for data in self._known.values():
            fitted = self._fitted(data, state.positions(data.nodes.astype(np.int64)))
            out.append(Body(data, BodyMotion(*fitted, rest, rest)))
        return Bodies.of_each(out)

    def _fitted(self, data: RigidBody, x: Array) -> tuple[Array, Array]:
        """Centre [m] and rotation of a part whose nodes are at x. Collective."""
        R, shift = best_motion(data.offsets, x - data.origin, self._stepper.scene.sum)
        return data.origin + shift, R

    def held(self) -> Bools:
        """For each owned node, which components are held as the parts would strain, too."""
        stepper = self._stepper
        held = stepper.system.prescribed.mask.reshape(-1, 3).copy()
        truly = PrescribedDofs(stepper.scene, stepper.system.prescribed.active).mask.reshape(-1, 3)
        for data in self._known.values():
            held[data.nodes] = truly[data.nodes]
        return held

    def borne(self, data: RigidBody) -> Array:
        """Forces that a part's nodes have to resist in the step that was solved last. Collective.

        They are in its frame, shape (nodes, 3) [N].
        """
        system = self._stepper.system
        rows = system.layout.rows.positions(data.nodes)
        u, d = (of.reshape(-1, 3) for of in (system.start, system.d.array_r))
        _, R = self._fitted(data, system.layout.rows.X[rows] + u[rows] + 0.5 * d[rows])
        f: Array = system.forces_out_of_balance.array_r.reshape(-1, 3)[rows]
        return -f @ R

    def loaded(self) -> list[tuple[RigidBody, Array]]:
        """The parts, and the resistance of their nodes in the last step, if any. Collective.

        Forces are in the parts' frames, shape (nodes, 3) [N].
        """
        self.remember()
        records = self.records()
        if self._borne is None or any(data.number not in self._borne for data in records):
            return []
        return [(data, self._borne[data.number]) for data in records]

    def remember(self) -> None:
        """Keep the forces of the last step beyond its equations. Collective."""
        if self._borne is None and self._stepped is self._stepper.system:
            self._borne = {data.number: self.borne(data) for data in self.records()}

    def forget(self) -> None:
        """Forget forces: an error has left the equations as it found them."""
        self._stepped = None

    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        self._stepped, self._borne = self._stepper.system, None
