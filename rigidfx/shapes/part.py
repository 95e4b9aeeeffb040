"""Shapes of a part: vectors of the whole structure, restricted to it.

The part's own rigid motions are taken out by its own mass, dependent vectors go, and the rest is
turned so that Ω = ΦᵀKΦ of the part's own cells is diagonal.
"""

from dataclasses import dataclass

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.flexible.internal_forces import Cells
from rigidfx.scene.scene import Scene
from rigidfx.shapes.expanded import Expanded
from rigidfx.shapes.orthonormal import INDEPENDENT, Basis, to_one
from rigidfx.shapes.responses import LACKING, Responses

MOST = 36  # shapes that a part gets unasked; Ω and the inertia of second order are full
BLOCK = 3  # unknowns in a block of PETSc's format, which shapes have to fill
# Size of a vector, once the part's rigid motion is taken out of it, over that before: below, it is
# the rounding of a motion in which the part does not strain.
STRAINING = 1e-9


@dataclass(frozen=True)
class PartShapes:
    """Shapes of a part about its present state, in space.

    Attributes:
        modes: Φ at the part's nodes of this rank, the largest displacement of each 1, shape
            (nodes, 3, m).
        stiffness: Ω = ΦᵀKΦ, diagonal, the softest first by ω², shape (m, m) [N/m].
        force: f₀ = Φᵀ f_int of the state, shape (m,) [N].
    """

    modes: Array
    stiffness: Array
    force: Array


class Part(Expanded):
    """Cells and nodes of a part about the state of the whole; `destroy` frees matrices.

    Its room for shapes is the number of its free unknowns less its rigid motions.
    """

    def __init__(
        self, responses: Responses, cells: Cells, nodes: Indices, name: str = "the part"
    ) -> None:
        """Assemble stiffness, mass and internal forces; `SceneError` if it cannot deform."""
        self._name = name
        stiffness = responses.stiffness
        held, state = stiffness.held.reshape(-1, 3)[nodes], stiffness.linear.shape.x.array
        free = self._checked(responses.scene, cells, held)
        known = responses.scene, stiffness.linear, cells, nodes
        bodies = stiffness.bodies
        beside = [np.setdiff1d(body.nodes, nodes).size for body in bodies.of.records]
        rigid = [
            (np.flatnonzero(np.isin(nodes, body.data.nodes)), body.data.offsets @ body.motion.R.T)
            for body, left in zip(bodies, responses.scene.sum(beside), strict=True)
            if left == 0
        ]
        super().__init__(*known, state.reshape(-1, 3)[nodes], held, rigid)
        self.room = free - self.motions.shape[2]

    def _checked(self, scene: Scene, cells: Cells, held: Bools) -> int:
        """Number of its dofs that are free; it can deform, as it is held. Collective."""
        count = sum(len(own) for own in cells.values())
        cells_in, free = map(int, scene.sum([count, int((~held).sum())]))
        few = f"it has {cells_in} cell, which no shapes divide. Name it Rigid, or refine its mesh"
        wrong = few if cells_in < 2 else "supports hold all of it. Take the Reduced away"
        if cells_in < 2 or not free:
            raise SceneError(f"Reduced '{self._name}': {wrong}.")
        return free

    def shapes(self, vectors: Array, count: int = MOST, block: int = 1) -> PartShapes:
        """Shapes from vectors of the whole; dependent ones are left out. Collective.

        Vectors have the shape (owned nodes, 3, k), the most important first. There are `count` at
        most, and a multiple of the block if they are more. `SceneError` on every rank, if it can
        have no such number of shapes, or its stiffness is not definite for one.
        """
        scene, own = self._scene, vectors[self.nodes]
        if count > self.room:
            raise SceneError(
                f"Reduced '{self._name}': shapes={count}, but it has no more than {self.room} "
                f"unknowns beside its rigid motions. Ask for {self.room} at most."
            )
        before = np.einsum("nak,nak->k", own, self.times_mass(own))
        deformed = self.unmoved(own)
        images = self.times_mass(deformed)
        after = np.einsum("nak,nak->k", deformed, images)
        before, after = np.sqrt(np.maximum(scene.sum(np.stack([before, after])), 0.0))
        some = after > STRAINING * before
        basis = self.begun(own[:, :, :0])
        basis.grow(deformed[:, :, some], images[:, :, some], after[some], count)
        m = len(basis)
        m -= m % block if m > block else 0
        Y = basis.vectors[:, :, :m]
        K = self.dot(Y, self.times_stiffness(Y))
        squares, turn = scene.comm.bcast(np.linalg.eigh(0.5 * (K + K.T)))
        if m and squares[0] <= 0:
            raise SceneError(
                f"Reduced '{self._name}': its stiffness is not definite in its present state, it "
                "buckles. Reduce it in a state before the limit load, or leave it flexible."
            )
        Y = Y @ turn
        Y, largest = to_one(scene.comm, Y)
        force = self.dot(Y, self.internal[:, :, None])[:, 0]
        return PartShapes(Y, np.diag(squares / largest**2), force)

    def extend(self, basis: Basis, vectors: Array, loads: int, room: int = 0) -> None:
        """Add vectors of the whole, (owned nodes, 3, k), to a basis at its nodes. Collective.

        Those of loads come first and count as far as they are independent; of their followers
        `LACKING` may be left out. The basis may have `room` more than `MOST`.
        """
        own = self.unmoved(vectors[self.nodes])
        images = self.times_mass(own)
        sizes = self.sizes(own, images)
        sizes[loads:] *= LACKING / INDEPENDENT
        basis.grow(own, images, sizes, MOST + room)

    def projected(self, modes: Array) -> PartShapes:
        """Shapes Φ, shape (nodes, 3, m), with Ω = ΦᵀKΦ and f₀ = Φᵀ f_int. Collective."""
        K = self.dot(modes, self.times_stiffness(modes))
        force = self.dot(modes, self.internal[:, :, None])[:, 0]
        return PartShapes(modes, 0.5 * (K + K.T), force)
