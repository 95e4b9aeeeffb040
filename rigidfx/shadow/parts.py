"""The cells and nodes of the bodies that have a shadow, in the shape that they are frozen in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.linalg import qr

from rigidfx.coupling.rows import Rows
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.scene.scene import Scene

__all__ = ["Parts", "watched"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Int32s = npt.NDArray[np.int32]


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
    """

    def __init__(self, scene: Scene, forces: InternalForces, bodies: Sequence[RigidBody]) -> None:
        """Number the rows. Collective.

        Args:
            scene: The problem.
            forces: Internal forces, which know the cells of each material.
            bodies: The bodies' data.
        """
        self.bodies = tuple(bodies)
        self._scene = scene
        none: list[npt.NDArray[np.int32]] = [np.empty(0, np.int32)]
        nodes = np.sort(np.concatenate([*none, *(body.nodes for body in bodies)]))
        self.cells: Cells = forces.cells(
            np.sort(np.concatenate([*none, *(body.cells for body in bodies)]))
        )
        self.rows = Rows(scene.space, nodes)
        self.at = tuple(self.rows.positions(body.nodes) for body in bodies)
        self.V: Array = np.zeros((nodes.size, 3))
        frozen = np.zeros((nodes.size, 3))
        for body, at in zip(bodies, self.at, strict=True):
            self.V[at] = body.offsets
            frozen[at] = body.origin + body.offsets
        self.shape: Array = (frozen - self.rows.X).reshape(-1)
        self._weights = m = scene.nodal_mass[nodes]
        light = np.divide(1.0, m, out=np.zeros_like(m), where=m > 0)
        self._lightness: Array = np.repeat(light[:, None], 3, axis=1)
        each = zip(self.bodies, self.at, strict=True)
        self._modes = [self._rigid_motions(at, body.length) for body, at in each]
        self._inverse = [np.linalg.pinv(block) for block in self._inertia()]

    def _rigid_motions(self, at: Ints, length: float) -> Array:
        """Rigid motions of nodes of a body, shape (nodes, 3, 6); rotations as lengths."""
        modes = np.zeros((at.size, 3, 6))
        modes[:, :, :3] = np.eye(3)
        modes[:, :, 3:] = np.cross(np.eye(3)[:, None], self.V[at] / length).transpose(1, 2, 0)
        return modes

    def _inertia(self) -> Array:
        """Σ m modesᵀ modes of each body, shape (bodies, 6, 6) [kg]. Collective."""
        local = np.zeros((len(self.bodies), 6, 6))
        for block, modes, at in zip(local, self._modes, self.at, strict=True):
            block += np.einsum("n,nik,nil->kl", self._weights[at], modes, modes)
        return np.asarray(self._scene.sum(local))

    def balance(self, force: Array) -> None:
        """Take out of forces, in place, what moves the bodies as a whole: by masses. Collective.

        Args:
            force: On the nodes of the rows, in the bodies' frames, shape (nodes, 3) [N].
        """
        for at, motion in self._of_rigid_motion(force):
            force[at] -= self._weights[at, None] * motion

    def unmoved(self, u: Array) -> Array:
        """Displacements without the rigid motion that fits them best, by masses. Collective.

        Args:
            u: Of the nodes of the rows, in the bodies' frames, shape (nodes, 3) [m].
        """
        out = u.copy()
        for at, motion in self._of_rigid_motion(self._weights[:, None] * u):
            out[at] -= motion
        return out

    def _of_rigid_motion(self, momentum: Array) -> list[tuple[Ints, Array]]:
        """Of each body its rows, and its rigid motion with the sums of a momentum. Collective."""
        modes = [m.reshape(-1, 6) for m in self._modes]
        local = [momentum[at].reshape(-1) @ m for m, at in zip(modes, self.at, strict=True)]
        sums = np.asarray(self._scene.sum(np.reshape(local, (-1, 6))))
        each = zip(self._inverse, sums, modes, self.at, strict=True)
        return [(at, (m @ (inverse @ total)).reshape(-1, 3)) for inverse, total, m, at in each]

    def in_space(self, u: Array, bodies: Bodies, out: Array) -> tuple[Array, Int32s]:
        """Displacements in the bodies' frames, as they are in space.

        Args:
            u: Of the nodes of the rows, shape (nodes, 3) [m].
            bodies: Bodies at present; some may be others than here.
            out: Of all owned nodes; those of bodies here are written into it.

        Returns:
            The same, and the owned cells of the bodies that are here.
        """
        now = {id(body.data): body.motion.R for body in bodies}
        cells: list[Int32s] = [np.empty(0, np.int32)]
        for data, at in zip(self.bodies, self.at, strict=True):
            if id(data) in now:
                out[data.nodes] = u[at] @ now[id(data)].T
                cells += [data.cells]
        return out, np.concatenate(cells)

    def size(self, force: Array) -> float:
        """Size of forces on the rows' nodes, by masses: sqrt(Σ f·f/m) [N/√kg]. Collective.

        Where a node has no mass, its force is left out.

        Args:
            force: Shape (nodes, 3) [N].
        """
        square = float(np.vdot(force * force, self._lightness))
        return float(np.sqrt(self._scene.sum(square)))

    def held(self) -> Ints:
        """Numbers of six rows of each body, on all ranks, that keep it from moving. Collective."""
        out = []
        for motions, at in zip(self._modes, self.at, strict=True):
            modes = motions.reshape(-1, 6)
            own = (self.rows.first + 3 * at[:, None] + np.arange(3)).reshape(-1)
            best = _independent(modes)
            offers = self._scene.comm.allgather((modes[best], own[best]))
            rows = np.concatenate([m for m, _ in offers])
            numbers = np.concatenate([n for _, n in offers])
            out.append(numbers[_independent(rows)])
        return np.concatenate([np.empty(0, np.int64), *out])


def _independent(modes: Array) -> Ints:
    """Six rows, at most, that are as independent as can be: by QR with pivoting."""
    if not len(modes):
        return np.empty(0, np.int64)
    _, order = qr(modes.T, mode="r", pivoting=True)
    return np.asarray(order[:6], dtype=np.int64)


def watched(bodies: Sequence[RigidBody], in_pieces: frozenset[str]) -> list[RigidBody]:
    """The bodies that can have a shadow, with the mass and inertia of their cells.

    Args:
        bodies: All bodies.
        in_pieces: Parts named rigid whose cells are not connected through facets.
    """
    return [body for body in bodies if not body.given and in_pieces.isdisjoint(body.named)]
