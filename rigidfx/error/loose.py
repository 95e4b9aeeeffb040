"""Rigid motions without resistance: e has none of them.

A freeze loses the phase of a vibration, so the rigid motion of a part without supports and springs
would grow in e without limit. The rigid motions Φ of the part are therefore removed from forces and
velocities, in the metric of the mass: r - MΦ(ΦᵀMΦ)⁻¹Φᵀr and v - Φ(ΦᵀMΦ)⁻¹ΦᵀM v. The remainder
strains the part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from rigidfx.base.types import Array, Bools, Ints
from rigidfx.error.frames import Frames
from rigidfx.error.linear_motion import Ground
from rigidfx.mechanics.rigid_motions import independent, rigid_motions
from rigidfx.scene.scene import Scene

__all__ = ["Loose", "held_in_part", "loose_parts"]


@dataclass(frozen=True)
class Loose:
    """The rigid motions of the parts that nothing holds.

    Attributes:
        nodes: Which owned nodes belong to such parts.
        motions: Φ at the owned nodes, shape (3 nodes, motions), ΦᵀMΦ = 1.
        momenta: MΦ, likewise.
    """

    scene: Scene
    nodes: Bools
    motions: Array
    momenta: Array

    @property
    def count(self) -> int:
        """Number of motions."""
        return int(self.motions.shape[1])

    def balanced(self, force: Array) -> Array:
        """Forces without those that move parts as a whole, shape (nodes, 3) [N]. Collective."""
        return self._without(force, self.motions, self.momenta)

    def still(self, motion: Array) -> Array:
        """Displacements or velocities without rigid motions, shape (nodes, 3). Collective."""
        return self._without(motion, self.momenta, self.motions)

    def _without(self, vectors: Array, by: Array, along: Array) -> Array:
        if not self.count:
            return vectors
        parts = np.asarray(self.scene.sum(by.T @ vectors.reshape(-1)))
        return vectors - (along @ parts).reshape(-1, 3)

    def pins(self) -> Ints:
        """Owned dofs that keep these motions from happening; as many on all ranks. Collective."""
        if not self.count:
            return np.empty(0, np.int64)
        best = independent(self.motions)
        offers = self.scene.comm.allgather(self.motions[best])
        rank = np.repeat(np.arange(len(offers)), [len(rows) for rows in offers])
        chosen = independent(np.concatenate(offers))
        first = sum(len(rows) for rows in offers[: self.scene.comm.rank])
        return np.asarray(best[chosen[rank[chosen] == self.scene.comm.rank] - first])


def loose_parts(
    scene: Scene,
    frames: Frames,
    held: Bools,
    ground: Ground | None,
    M: PETSc.Mat,
    among: Bools | None = None,
) -> Loose:
    """The rigid motions that neither supports nor springs resist. Collective.

    Args:
        scene: The problem.
        frames: Shape and connected parts.
        held: Which owned dofs supports hold.
        ground: Springs to the ground, if there are any.
        M: Mass matrix of the owned nodes.
        among: Which connected parts are asked for; all if None.
    """
    nodes, motions = _unresisted(scene, frames, held, ground, among)
    momenta = np.empty_like(motions)
    x, y = M.createVecs()
    for k in range(motions.shape[1]):
        x.array[:] = motions[:, k]
        M.mult(x, y)
        momenta[:, k] = y.array_r
    x.destroy()
    y.destroy()
    if motions.shape[1]:
        inverse = np.linalg.inv(np.linalg.cholesky(scene.sum(motions.T @ momenta)))
        motions, momenta = motions @ inverse.T, momenta @ inverse.T
    return Loose(scene, nodes, motions, momenta)


def _unresisted(
    scene: Scene, frames: Frames, held: Bools, ground: Ground | None, among: Bools | None = None
) -> tuple[Bools, Array]:
    """The same as they are, not normalized. Collective; arguments as of `loose_parts`.

    Returns:
        Which owned nodes belong to such parts; the motions, shape (3 nodes, motions).
    """
    free = _unsupported(scene, frames, held)
    if among is not None:
        free = free & among
    n, columns = len(frames.shape), []
    nodes: Bools = np.zeros(n, dtype=bool)
    for k in np.flatnonzero(free):
        V = _motions(scene, frames, k)
        K = np.zeros((6, 6)) if ground is None else ground.resistance(scene, V)
        unresisted = _kernel(K)
        if unresisted.shape[1]:
            nodes |= frames.part == k
            columns.append((V @ unresisted).reshape(3 * n, unresisted.shape[1]))
    return nodes, np.concatenate([np.empty((3 * n, 0)), *columns], axis=1)


def held_in_part(scene: Scene, frames: Frames, held: Bools) -> bool:
    """Whether supports leave rigid motions of a part that they hold: along a face, say. Collective.

    Args:
        scene: The problem.
        frames: Shape and connected parts.
        held: Which owned dofs supports hold.
    """
    for k in np.flatnonzero(~_unsupported(scene, frames, held)):
        V = _motions(scene, frames, k).reshape(-1, 6)[held]
        if _kernel(np.asarray(scene.sum(V.T @ V))).shape[1]:
            return True
    return False


def _motions(scene: Scene, frames: Frames, k: np.integer) -> Array:
    """Rigid motions of a connected part at the owned nodes, shape (nodes, 3, 6)."""
    own, (low, high) = frames.part == k, (scene.parts.lower[k], scene.parts.upper[k])
    V: Array = np.zeros((len(frames.shape), 3, 6))
    V[own] = rigid_motions(frames.shape[own] - (low + high) / 2, float(np.linalg.norm(high - low)))
    return V


def _kernel(K: Array) -> Array:
    """Vectors that a symmetric matrix takes to nothing, by columns."""
    values, vectors = np.linalg.eigh(K)
    return np.asarray(vectors[:, values <= np.sqrt(np.finfo(np.float64).eps) * values[-1]])


def _unsupported(scene: Scene, frames: Frames, held: Bools) -> Bools:
    """Which connected parts no support holds at any node. Collective."""
    at = held.reshape(-1, 3).any(axis=1)
    counts = np.bincount(frames.part[at], minlength=scene.parts.count)
    return np.asarray(scene.sum(counts.astype(np.float64)) == 0)
