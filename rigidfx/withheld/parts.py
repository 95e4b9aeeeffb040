"""The cells and nodes of some bodies, in the shape that they are frozen in."""

from collections.abc import Sequence

import numpy as np

from rigidfx.base.types import Array, Indices, Ints
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.rows import Rows
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.scene.scene import Scene


class Parts:
    """Rows of the nodes of some bodies, which share none; each body has its own frame.

    Attributes:
        bodies: The bodies' data.
        cells: Their owned cells by subdomain id.
        rows: Rows of their nodes.
        at: Of each body, its nodes among the rows.
        V: Positions of the rows' nodes relative to the centre of their body, in its frame, shape
            (nodes, 3) [m].
        shape: Displacement at the freeze, of the rows [m].
        coordinates: Of each body, [1, V, Φ] of its nodes, shape (nodes, 4 + 3 m) [1, m, 1].
    """

    def __init__(self, scene: Scene, forces: InternalForces, bodies: Sequence[RigidBody]) -> None:
        """Number the rows. Collective."""
        self.bodies = tuple(bodies)
        self._scene = scene
        none: list[Indices] = [np.empty(0, np.int32)]
        nodes = np.sort(np.concatenate([*none, *(body.nodes for body in bodies)]))
        self.cells: Cells = forces.cells(
            np.sort(np.concatenate([*none, *(body.cells for body in bodies)]))
        )
        self.rows = Rows(scene.space, nodes)
        self.at = tuple(self.rows.positions(body.nodes) for body in bodies)
        self.V: Array = np.zeros((nodes.size, 3))
        shape = np.zeros((nodes.size, 3))
        for body, at in zip(bodies, self.at, strict=True):
            self.V[at] = body.offsets
            shape[at] = body.displacement
        self.shape: Array = shape.reshape(-1)
        self.coordinates = tuple(body.coordinates() for body in bodies)
        self._spans = tuple(map(_span, self.at))

    def linear(self, numbers: Array) -> Array:
        """What is linear in a node's place in its body: [1, V, Φ₁, ...] times numbers of that.

        Numbers have the shape (bodies, n, k); missing ones are zero. Shape (nodes, k).
        """
        out = np.empty((len(self.V), numbers.shape[2]))
        for k, (own, places) in enumerate(zip(self._spans, self.coordinates, strict=True)):
            of_body: Array = numbers[k, : places.shape[1]]
            out[own] = places[:, : len(of_body)] @ of_body
        return out

    def shape_of(self, linear: LinearForms) -> None:
        """Give forms the shape of the bodies, and none elsewhere. Collective."""
        x = linear.shape.x
        x.array[:] = 0.0
        x.array[self.rows.dofs] = self.shape
        x.scatter_forward()

    def mass(self) -> Mass:
        """Mass operator of the rows, all lumped masses counted: a new one. Collective."""
        counted = np.ones(self.rows.nodes.size, dtype=bool)
        return Mass(self._scene, self.rows, self.cells, counted)


def _span(at: Ints) -> slice | Ints:
    """Numbers of rows; as a slice, which copies nothing, where one follows the other."""
    first = int(at[0]) if at.size else 0
    whole = np.array_equal(at, np.arange(first, first + at.size))
    return slice(first, first + at.size) if whole else at


def watched(bodies: Sequence[RigidBody], in_pieces: frozenset[str]) -> list[RigidBody]:
    """The bodies whose ρ is known, with cells and with the mass and inertia of these.

    Parts named rigid that are `in_pieces` are none: facets do not connect their cells.
    """
    own = (body for body in bodies if not body.given and not body.is_face)
    return [body for body in own if in_pieces.isdisjoint(body.named)]
