"""Contact between two surfaces that deform: nodes of one against triangles of the other.

In a step a node meets one triangle. Weights N and normal n are those of the node's projection on
the triangle's plane at the midpoint, so that n is along x_s - Σ N_a x_a, and

    ḡ₁ = ḡ₀ + n·(Δx_s - Σ N_a Δx_a),    force -[U] n on the node, N_a [U] n on the triangle's.

So both momenta are kept exactly, and energy with U(ḡ) by construction, for any step (T. A. Laursen
and V. Chawla, IJNME 40 (1997) 863). ḡ is summed up while a node is pressed. While it is free, ḡ is
the distance from the plane, or zero if that is negative, since a negative gap would create energy.
By the rotation of the normal in a step ḡ drifts from the distance, by second order in Δt.

The derivative neglects the changes of n and N, which are of the size penetration over facet:
Newton's method takes one or two more iterations for that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.mesh_order import MeshOrder
from rigidfx.base.types import Array, Ints
from rigidfx.effects.action import ContactAction, Structure, Touch
from rigidfx.effects.contacts.pair_surface import PairSurface, projected
from rigidfx.effects.contacts.penalty import outdated, secant, stored
from rigidfx.effects.contacts.pressing import CLOSED
from rigidfx.effects.motion import Instant, Motion, Tangent
from rigidfx.effects.nodes import SharedNodes

__all__ = ["PairForces"]


_SEARCH = PETSc.Log.Event("rigidfxSearch")  # what PETSc's log calls the look for triangles


class PairForces(ContactAction):
    """The forces between two surfaces; its results are equal on all ranks."""

    def __init__(self, effect: Any, surface: PairSurface, structure: Structure) -> None:
        """Find which nodes are whose. Collective.

        Args:
            effect: The contact.
            surface: Both surfaces.
            structure: Its nodes and bodies.
        """
        self.kind, self.title, self.couples = effect.kind, effect.title, True
        scene = structure.scene
        self._comm: MPI.Intracomm = scene.comm
        self._surface, self._static = surface, structure.static
        assert structure.notes is not None  # else it is not bound
        self._memory = memory_of(structure.notes.get(id(effect)), surface)
        structure.notes[id(effect)] = self._memory
        self._nodes = SharedNodes(structure, surface.nodes, surface.numbers, surface.size)
        self._in_tangent: Array = np.zeros(surface.slaves.size)
        self.rounding = float(np.linalg.norm(surface.stiffness)) * self._nodes.far()
        self._forget()

    def _forget(self) -> None:
        self._x0: Array | None = None
        self._half: Array = np.zeros((self._surface.size, 3))
        self._active: Ints = np.empty(0, np.int64)
        self._corners: Ints = np.empty((0, 3), np.int64)
        self._gaps: tuple[Array, Array] = np.empty(0), np.empty(0)
        self._normals: Array = np.empty((0, 3))
        self._weights: Array = np.empty((0, 3))
        self._slope: Array = np.empty(0)
        self._next = replace(
            self._memory, gap=self._memory.gap.copy(), mate=self._memory.mate.copy()
        )

    def set_time(self, t: float, dt: float) -> None:
        """A new attempt at a step: findings of the last one are forgotten."""
        self._forget()

    # In each iteration --------------------------------------------------------------------------

    def resist(self, motion: Motion, forces: Any) -> None:
        """See `Action`; between nodes of one body there is nothing to see. Collective."""
        if self._nodes.in_one_body:
            return
        moved = self._nodes.moved(motion)
        if self._x0 is None:
            self._x0 = self._nodes.positions(motion.start)
            if not self._static:
                self._meet(self._x0, self._x0 + 0.5 * moved)
        if self._static:
            self._meet(self._x0 + moved, self._x0 + moved)
        slaves = self._surface.slaves[self._active]
        half = self._half = self._x0 + (1.0 if self._static else 0.5) * moved
        distance, n, N = projected(half[slaves], half[self._corners])
        apart = moved[slaves] - np.einsum("na,nai->ni", N, moved[self._corners])
        g0 = distance if self._static else self._gaps[0]
        g1 = distance if self._static else g0 + (n * apart).sum(axis=1)
        value, self._slope = secant(self._surface.stiffness[self._active], g0, g1)
        if self._static:  # the derivative by both ends, which are alike
            self._slope = 2 * self._slope
        self._gaps, self._normals, self._weights = (g0, g1), n, N
        pressure = value[:, None] * n
        force = np.zeros_like(self._x0)
        np.add.at(force, slaves, pressure)
        np.add.at(force, self._corners, -N[:, :, None] * pressure[:, None])
        self._nodes.add(force, forces)

    def _meet(self, x0: Array, x: Array) -> None:
        """Find which triangle each node may meet in this step.

        Args:
            x0: Positions that gaps are taken at, shape (size, 3) [m].
            x: Positions at which triangles are looked for, likewise.
        """
        surface, memory = self._surface, self._memory
        with _SEARCH:
            mate = surface.mates(x, self._nodes.rigid)
        closed = memory.gap < 0
        mate = np.where(closed & (mate < 0), memory.mate, mate)
        self._active = np.flatnonzero(mate >= 0)
        self._corners = surface.triangles[mate[self._active]]
        g, _, _ = projected(x0[surface.slaves[self._active]], x0[self._corners])
        g0 = np.where(closed[self._active], memory.gap[self._active], np.maximum(g, 0.0))
        self._gaps = g0, g0
        self._next = PairMemory(np.full(closed.size, np.inf), mate, surface)

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """See `Action`: Σ [U]' (Lᵀ G)(Gᵀ P), G = n at the node and -N n at the triangle's."""
        used = np.flatnonzero(self._slope > 0)
        self._in_tangent = self._slopes()
        if not used.size:
            return
        nodes = np.c_[self._surface.slaves[self._active[used]], self._corners[used]]
        weights = np.c_[np.ones(used.size), -self._weights[used]]
        G = weights[:, :, None] * self._normals[used, None]
        self._nodes.couple(nodes, G, self._slope[used], tangent)

    def outdated(self) -> bool:
        """See `Action`."""
        return outdated(self._surface.stiffness, self._in_tangent, self._slopes())

    def _slopes(self) -> Array:
        """Derivatives of [U] by ḡ₁ of all nodes that are kept out, shape (n,) [N/m]."""
        out = np.zeros(self._surface.slaves.size)
        out[self._active] = self._slope
        return out

    # After a step -------------------------------------------------------------------------------

    def accept(self) -> None:
        """See `Action`."""
        self._next.gap[self._active] = self._gaps[1]
        self._memory.gap, self._memory.mate = self._next.gap, self._next.mate

    def stored(self, at: Instant) -> float:
        """See `Action`."""
        if self._comm.rank:
            return 0.0  # all ranks know the same
        g = np.where(np.isfinite(self._memory.gap), self._memory.gap, 0.0)
        return float(stored(self._surface.stiffness, g).sum())

    def pressing(self) -> tuple[Ints, Array]:
        """See `ContactAction`: along the normals, for corners that bear a share of a node."""
        surface, ways = self._surface, np.zeros((self._surface.size, 3, 3))
        slaves = surface.slaves[self._active]
        deepest = np.minimum(*self._gaps)
        deep = deepest < -CLOSED * np.abs(self._half[slaves]).max(axis=1, initial=0.0)
        push = (surface.stiffness[self._active] * deepest)[deep, None] * self._normals[deep]
        share = np.where(self._weights > CLOSED, self._weights, 0.0)[deep]
        np.add.at(ways[:, 0], slaves[deep], -push)
        np.add.at(ways[:, 0], self._corners[deep], share[:, :, None] * push[:, None])
        return self._nodes.on_bodies(ways)

    def touch(self) -> Touch:
        """See `Action`; a node pressed within one body has no force, but keeps its energy."""
        if self._comm.rank:
            return Touch(self.title)
        if self._nodes.in_one_body:
            gap, k = self._memory.gap, self._surface.stiffness
            g = np.where(np.isfinite(gap), gap, 0.0)
            deepest, count = float(np.maximum(-g, 0.0).max(initial=0.0)), np.count_nonzero(g < 0)
            energy = float(stored(k, g).sum())
            return Touch(self.title, energy=energy, penetration=deepest, nodes=int(count))
        surface, g = self._surface, self._gaps[1]
        slaves, k = surface.slaves[self._active], surface.stiffness[self._active]
        value, _ = secant(k, *self._gaps)
        force = -value[:, None] * self._normals
        if surface.itself:  # each has its reaction on the same surface
            total, moment = np.zeros(3), np.zeros(3)
        else:
            total, moment = force.sum(axis=0), np.cross(self._half[slaves], force).sum(axis=0)
        return Touch(
            self.title,
            force=total,
            moment=moment,
            pressing=float(-value.sum()),
            energy=float(stored(k, g).sum()),
            penetration=float(np.maximum(-g, 0.0).max(initial=0.0)),
            nodes=int(np.count_nonzero(g < 0)),
        )

    def closes_after(self, v: Array, dt: float, at: Instant) -> float:
        """See `ContactAction`. Collective."""
        if self._nodes.in_one_body:
            return np.inf
        x, w = self._nodes.positions(at), self._nodes.velocities(v, at.bodies)
        if (self._memory.gap < 0).any():
            return -1.0
        surface = self._surface
        with _SEARCH:
            mate = surface.mates(x + 0.5 * dt * w, self._nodes.rigid)
        met = np.flatnonzero(mate >= 0)
        slaves, corners = surface.slaves[met], surface.triangles[mate[met]]
        g, n, N = projected(x[slaves], x[corners])
        rate = (n * (w[slaves] - np.einsum("na,nai->ni", N, w[corners]))).sum(axis=1)
        comes = rate < 0
        with np.errstate(over="ignore"):  # in longer than there are numbers
            return float((np.maximum(g[comes], 0.0) / -rate[comes]).min(initial=np.inf))


@dataclass
class PairMemory:
    """Memory of a pair from step to step, of each node that is kept out.

    Attributes:
        gap: ḡ [m]; infinite while it meets nothing.
        mate: The triangle that it met last, -1 if none.
        surface: Both surfaces, whose numbers these are.
    """

    gap: Array
    mate: Ints
    surface: PairSurface

    def __deepcopy__(self, known: dict[int, Any]) -> PairMemory:
        """The same with arrays of its own."""
        return replace(self, gap=self.gap.copy(), mate=self.mate.copy())

    def part(self, order: MeshOrder) -> Any:
        """A rank's part of a checkpoint: where its nodes are in the mesh."""
        surface = self.surface
        return surface.numbers, order.nodes[surface.nodes]

    def whole(self, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> PairNote:
        """The part of a checkpoint, by numbers of nodes in the mesh."""
        surface = self.surface
        number = np.empty(surface.size, np.int64)
        for own, in_mesh in parts:
            number[own] = in_mesh
        closed = np.flatnonzero(np.isfinite(self.gap) | (self.mate >= 0))
        corners = np.full((closed.size, 3), -1)
        met = self.mate[closed] >= 0
        corners[met] = np.sort(number[surface.triangles[self.mate[closed][met]]], axis=1)
        return PairNote(number[surface.slaves[closed]], self.gap[closed], corners)


@dataclass
class PairNote:
    """The memory of a pair as a checkpoint keeps it.

    Attributes:
        nodes: Numbers in the mesh of the nodes that meet something.
        gap: ḡ of each [m].
        corners: Numbers of the corners of the triangle that each met last, sorted; -1 if none.
        order: Numbers of this rank's nodes, once it is given back.
    """

    nodes: Ints
    gap: Array
    corners: Ints
    order: MeshOrder | None = None

    def given(self, order: MeshOrder) -> PairNote:
        """The same for a rank."""
        return replace(self, order=order)

    def memory(self, surface: PairSurface) -> PairMemory:
        """The memory of surfaces as ranks number them now. Collective."""
        order = self.order
        assert order is not None
        assert order.comm is not None
        number = np.zeros(surface.size, np.int64)
        number[surface.numbers] = order.nodes[surface.nodes]
        order.comm.Allreduce(MPI.IN_PLACE, number)
        slaves = {int(node): k for k, node in enumerate(number[surface.slaves])}
        corners = np.sort(number[surface.triangles], axis=1)
        triangles = {row.tobytes(): k for k, row in enumerate(corners)}
        out = _fresh(surface)
        places = [slaves[int(node)] for node in self.nodes]
        out.gap[places] = self.gap
        out.mate[places] = [triangles.get(row.tobytes(), -1) for row in self.corners]
        return out


def memory_of(known: Any, surface: PairSurface) -> PairMemory:
    """The memory of a pair. Collective.

    Args:
        known: A memory, the note of a checkpoint, or None.
        surface: Both surfaces.
    """
    if known is None:
        return _fresh(surface)
    return known.memory(surface) if isinstance(known, PairNote) else known


def _fresh(surface: PairSurface) -> PairMemory:
    """That nothing has met."""
    n = surface.slaves.size
    return PairMemory(np.full(n, np.inf), np.full(n, -1), surface)
