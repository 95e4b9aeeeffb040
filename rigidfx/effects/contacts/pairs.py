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

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.types import Array, Ints
from rigidfx.effects.action import Structure, Touch
from rigidfx.effects.contacts.pair_surface import PairSurface, projected
from rigidfx.effects.contacts.penalty import CLOSED, ContactForces, secant, soonest
from rigidfx.effects.motion import Instant, Motion, Tangent
from rigidfx.effects.nodes import SharedNodes

_SEARCH = PETSc.Log.Event("rigidfxSearch")  # PETSc's log of the search for triangles


class PairForces(ContactForces):
    """The forces between two surfaces; its results are equal on all ranks."""

    couples = True

    def __init__(self, effect: Any, surface: PairSurface, structure: Structure) -> None:
        """Find which nodes are whose. Collective."""
        super().__init__(effect, surface.stiffness, structure)
        self._comm: MPI.Intracomm = structure.scene.comm
        self._surface = surface
        n = surface.slaves.size
        self._fresh = PairMemory(np.full(n, np.inf), np.full(n, -1))
        assert structure.notes is not None  # else it is not bound
        self._notes, self._effect = structure.notes, effect
        self._nodes = SharedNodes(structure, surface.nodes, surface.numbers, surface.size)
        self.rounding = float(np.linalg.norm(self._k)) * self._nodes.far()
        self.set_time(0.0, 0.0)

    @property
    def _memory(self) -> PairMemory:
        memory: PairMemory = self._notes.get(id(self._effect), self._fresh)
        return memory

    def set_time(self, t: float, dt: float) -> None:
        """Begin an attempt at a step: findings of the last one are forgotten."""
        self._x0: Array | None = None
        self._half: Array = np.zeros((self._surface.size, 3))
        self._mate: Ints | None = None  # the triangle that each node may meet in the step
        self._active: Ints = np.empty(0, np.int64)
        self._slaves: Ints = self._active
        self._corners: Ints = np.empty((0, 3), np.int64)
        self._gaps: tuple[Array, Array] = np.empty(0), np.empty(0)
        self._normals: Array = np.empty((0, 3))
        self._weights: Array = np.empty((0, 3))
        self._slope: Array = np.empty(0)

    # In each iteration --------------------------------------------------------------------------

    def resist(self, motion: Motion, forces: Any) -> None:
        """Add the resistance; between nodes of one body there is none. Collective."""
        if self._nodes.in_one_body:
            return
        moved = self._nodes.moved(motion)
        if self._x0 is None:
            self._x0 = self._nodes.positions(motion.start)
            if not self._static:
                self._meet(self._x0, self._x0 + 0.5 * moved)
        if self._static:
            self._meet(self._x0 + moved, self._x0 + moved)
        slaves = self._slaves
        half = self._half = self._x0 + (1.0 if self._static else 0.5) * moved
        distance, n, N = projected(half[slaves], half[self._corners])
        apart = moved[slaves] - np.einsum("na,nai->ni", N, moved[self._corners])
        g0 = distance if self._static else self._gaps[0]
        g1 = distance if self._static else g0 + (n * apart).sum(axis=1)
        value, self._slope = secant(self._k[self._active], g0, g1, self._static)
        self._gaps, self._normals, self._weights = (g0, g1), n, N
        pressure = value[:, None] * n
        force = np.zeros_like(self._x0)
        np.add.at(force, slaves, pressure)
        np.add.at(force, self._corners, -N[:, :, None] * pressure[:, None])
        self._nodes.add(force, forces)

    def _meet(self, x0: Array, x: Array) -> None:
        """Find the triangle of each node at places x, and gaps at places x0, both (size, 3) [m]."""
        surface, memory = self._surface, self._memory
        with _SEARCH:
            mate = surface.mates(x, self._nodes.rigid)
        closed = memory.gap < 0
        self._mate = mate = np.where(closed & (mate < 0), memory.mate, mate)
        self._active = on = np.flatnonzero(mate >= 0)
        self._slaves, self._corners = surface.slaves[on], surface.triangles[mate[on]]
        g, _, _ = projected(x0[self._slaves], x0[self._corners])
        g0 = np.where(closed[on], memory.gap[on], np.maximum(g, 0.0))
        self._gaps = g0, g0

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """Add Σ [U]' (Lᵀ G)(Gᵀ P), G = n at the node and -N n at the triangle's."""
        used = np.flatnonzero(self._slope > 0)
        self._in_tangent = self._slopes()
        if not used.size:
            return
        nodes = np.c_[self._slaves[used], self._corners[used]]
        weights = np.c_[np.ones(used.size), -self._weights[used]]
        G = weights[:, :, None] * self._normals[used, None]
        self._nodes.couple(nodes, G, self._slope[used], tangent)

    def _slopes(self) -> Array:
        out = np.zeros(self._k.size)
        out[self._active] = self._slope
        return out

    # After a step -------------------------------------------------------------------------------

    def accept(self) -> None:
        """Store ḡ and the triangle of each node."""
        if self._mate is not None:
            gap = self._fresh.gap.copy()
            gap[self._active] = self._gaps[1]
            self._notes[id(self._effect)] = PairMemory(gap, self._mate)

    def _gap(self, at: Instant) -> Array:
        # All ranks have the same gaps, which count on the first one.
        return self._memory.gap if self._comm.rank == 0 else np.full(self._k.size, np.inf)

    def pressing(self) -> tuple[Ints, Array]:
        """Pressed nodes: along normals, for corners that bear a share of a node."""
        ways = np.zeros((self._surface.size, 3, 3))
        deepest = np.minimum(*self._gaps)
        deep = deepest < -CLOSED * np.abs(self._half[self._slaves]).max(axis=1, initial=0.0)
        push = (self._k[self._active] * deepest)[deep, None] * self._normals[deep]
        share = np.where(self._weights > CLOSED, self._weights, 0.0)[deep]
        np.add.at(ways[:, 0], self._slaves[deep], -push)
        np.add.at(ways[:, 0], self._corners[deep], share[:, :, None] * push[:, None])
        return self._nodes.acted(ways)

    def touch(self) -> Touch:
        """Touch of the step; a node pressed within one body has no force, but keeps its energy."""
        if self._comm.rank:
            return Touch(self.title)
        if self._nodes.in_one_body:
            none = np.zeros((self._k.size, 3))
            return self._touched(self._k, self._memory.gap, none, none)
        k = self._k[self._active]
        force = -secant(k, *self._gaps)[0][:, None] * self._normals
        out = self._touched(k, self._gaps[1], force, self._half[self._slaves])
        if self._surface.itself:  # each has its reaction on the same surface
            out = replace(out, force=np.zeros(3), moment=np.zeros(3))
        return out

    def closes_after(self, v: Array, dt: float, at: Instant) -> float:
        """Time until the first gap closes; -1 if a node touches [s]. Collective."""
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
        apart = w[slaves] - np.einsum("na,nai->ni", N, w[corners])
        return soonest(np.maximum(g, 0.0), (n * apart).sum(axis=1))


@dataclass(frozen=True)
class PairMemory:
    """Memory of a pair from step to step, of each node that is kept out.

    Attributes:
        gap: ḡ [m]; infinite while it meets nothing.
        mate: The triangle that it met last, -1 if none.
    """

    gap: Array
    mate: Ints
