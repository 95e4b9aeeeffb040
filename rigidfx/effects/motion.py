"""An iterate of a step as actions see it, and where these hand in forces and stiffness.

A node of a body has constant body-fixed coordinates a, shape (n,), and moves by a · D with one
matrix D of the body, shape (n, 3). Forces on nodes enter the body by their moments Σ a fᵀ, and a
stiffness of nodes by the derivative of these moments. Actions add what this rank's nodes have;
what all ranks know counts on the first one (`Structure.once`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.base.types import Array, Ints
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments


@dataclass(frozen=True)
class Instant:
    """A state of bodies and of rows at t [s]; displacements are those at a step's start if None."""

    bodies: Bodies
    u: Array | None = None
    t: float = float("nan")


@dataclass(frozen=True)
class Motion:
    """An iterate of a step.

    Attributes:
        d: Increments of the nodes of the rows, a PETSc vector [m].
        increments: Those of the bodies.
        dt: Length of the step [s]; of no meaning in statics.
        begun: The start of the step, the same object as long as nothing of it changes.
    """

    d: Any
    increments: Increments
    dt: float
    begun: Instant | None = None

    @property
    def start(self) -> Instant:
        """The start of the step."""
        return Instant(self.increments.start) if self.begun is None else self.begun

    @property
    def array_r(self) -> Array:
        """Increments of the rows, one number each [m]."""
        return np.asarray(self.d.array_r)

    @property
    def nodes(self) -> Array:
        """The same, shape (nodes, 3) [m]."""
        return self.array_r.reshape(-1, 3)

    @property
    def finite(self) -> bool:
        """Whether it is finite on this rank: an iteration may run away."""
        every = self.array_r, self.increments.unknowns
        return all(bool(np.isfinite(values).all()) for values in every)


@dataclass(frozen=True)
class Forces:
    """Forces on nodes and bodies, which actions add to.

    Attributes:
        vector: On the nodes of the rows, a PETSc vector [N].
        moments: Σ a fᵀ of this rank's forces on each body, shape (bodies, n, 3) [N, N m].
        torques: Torques on the bodies as such, shape (bodies, 3) [N m].
    """

    vector: Any
    moments: Array
    torques: Array

    @classmethod
    def none(cls, vector: Any, pose: Array | None = None) -> Forces:
        """Forces on a vector as it is, and none on bodies with places `pose`, (bodies, n, 3)."""
        pose = np.empty((0, 1, 3)) if pose is None else pose
        return cls(vector, np.zeros(pose.shape), np.zeros((len(pose), 3)))

    @property
    def nodes(self) -> Array:
        """On the nodes of the rows, shape (nodes, 3) [N]."""
        return np.asarray(self.vector.array.reshape(-1, 3))

    @property
    def parts(self) -> tuple[Array, ...]:
        """All of them."""
        return self.vector.array, self.moments, self.torques

    def scale(self, factor: float) -> None:
        """Multiply all of them."""
        for part in self.parts:
            part *= factor

    def add(self, at: Any, forces: Array) -> None:
        """Add forces on some `Nodes` of this rank, shape (nodes, 3) [N]."""
        count = at.rows.size
        self.nodes[at.rows] += forces[:count]
        if count < len(forces):
            self.moments[...] += at.gather(forces[count:])


@dataclass(frozen=True)
class ForcesOfNodes:
    """Forces on all owned nodes of this rank, in bodies or not, shape (owned nodes, 3) [N]."""

    nodes: Array

    def add(self, at: Any, forces: Array) -> None:
        """Add forces on some `Nodes` of this rank, shape (nodes, 3) [N]."""
        self.nodes[at.nodes] += forces


class Tangent:
    """A tangent that is being assembled.

    Attributes:
        matrix: Takes stiffness of free nodes, and of pairs of unknowns.
        prolongation: Map between unknowns and dofs.
        moments: Derivative of Σ a fᵀ of this rank's forces by the unknowns of their body, shape
            (bodies, 3 n, unknowns).
    """

    def __init__(self, matrix: Any, prolongation: Any) -> None:
        """Begin with none; the matrix has `add_nodal` and `add_coupling`, see `CondensedMatrix`."""
        self.matrix, self.prolongation = matrix, prolongation
        P = prolongation.increments.P
        self._moves: Array = P.reshape(len(P), P.shape[1] // 3, 3, P.shape[2])
        self.moments: Array = np.zeros_like(P)

    @property
    def blocks(self) -> Array:
        """Derivative of the forces on the bodies' unknowns, shape (bodies, 6, 6) [N/m]."""
        return np.asarray(self.prolongation.increments.L.swapaxes(1, 2) @ self.moments)

    def add(self, at: Any, blocks: Array, which: Ints | None = None) -> None:
        """Add blocks of stiffness [N/m] of each of some `Nodes`, or of sorted ones. Collective."""
        which = np.arange(len(at.nodes)) if which is None else which
        count = int(np.searchsorted(which, at.rows.size))
        self.matrix.add_nodal(at.free[which[:count]], blocks[:count])
        if count < len(blocks):
            held = which[count:] - at.rows.size
            moved = at.follow(self._moves)
            forces = np.zeros_like(moved)
            forces[held] = (blocks[count:] @ moved[held].reshape(len(held), 3, -1)).reshape(
                len(held), -1
            )
            self.moments += at.gather(forces).reshape(self.moments.shape)

    def add_spread(self, spread: Array, K: Array) -> None:
        """Add K, shape (3, 3) [N/m], on nodes of bodies, Σ w a aᵀ being (bodies, n, n)."""
        if len(spread):
            rows = (K @ self._moves).reshape(*spread.shape[:2], -1)
            self.moments += (spread @ rows).reshape(self.moments.shape)
