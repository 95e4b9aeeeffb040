"""How far a body is from the expansion that its shapes have, and where: ν.

It is the largest of three parts,

    |V(w) - ½ d·K d|/(½ d·K d) ,    ½ |e·M d|/d·M d ,    e = Φ Ω⁻¹ Φᵀ g ,    ½ |ΔΩ|/Ω ,

of the energy and of the displacement d = Φq. e is the response of the shapes to the forces g of
second order. A bar in tension is stiffer as it bends, which may be little of the energy of the
tension and much of the bend.

A plate that bends between edges which are held is stretched. Of the strains ε = ½ ∇dᵀ∇d of a bend
d those along shapes are in e, see `rigidfx.mechanics.shapes`, and nodes go by w = -K⁺h to relieve
others; h are their forces. Stresses of ε + Bw are in balance, and stiffen shapes as those of a
stretch do. They count where their energy is more than `LACKING` of that of ε.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array, Indices, Ints
from rigidfx.mechanics.rigid_body import Body
from rigidfx.mechanics.shapes import SelfStresses, Shapes
from rigidfx.shapes.expanded import Expanded
from rigidfx.shapes.faces import vectors
from rigidfx.shapes.interface import Interface
from rigidfx.shapes.orthonormal import INDEPENDENT, slowest, whole_groups
from rigidfx.shapes.part import MOST
from rigidfx.shapes.responses import LACKING, Responses


@dataclass(frozen=True)
class About:
    """The expansion of a body: its cells about the frozen shape, responses about the start.

    Q is its rotation from the start to the freeze, shape (3, 3).
    """

    responses: Responses
    part: Expanded
    Q: Array

    @cached_property
    def beside(self) -> Interface:
        """The cells beside it. Collective, when it is first asked for."""
        return Interface(self.responses.stiffness, self.part.cells, self.part.nodes)

    @cached_property
    def on_supports(self) -> bool:
        """Whether cells beside it join it to supports. Collective, when it is first asked for."""
        held = self.responses.stiffness.held.reshape(-1, 3, 1).astype(np.float64)
        return self.beside.holds and bool(self.responses.act_on(self.part.nodes, held)[0])

    @cached_property
    def joined(self) -> bool:
        """Whether joints or springs hold it, or what it hangs together with. Collective."""
        own = self.responses
        F = own.stiffness.of_springs(np.tile(np.eye(3), (own.scene.owned_nodes, 1, 1)))
        for vector in vectors(own):
            F[vector.nodes] = 1.0
        return bool(own.act_on(self.part.nodes, F).any())

    def unspanned(
        self, modes: Array, stiffness: Array, F: Array, most: int = MOST
    ) -> tuple[Array, bool]:
        """Forces that strain it by more than `LACKING` otherwise than shapes can. Collective.

        With δ the response less its rigid motion, ½ δ·Kδ is its strain energy and ½ h·Ω⁻¹h that of
        shapes Φ, (nodes, 3, m), h = ΦᵀKδ. In a part that is the whole these are f·K⁻¹f and g·Ω⁻¹g,
        g = Φᵀf.

        Combinations of forces on the whole, (owned nodes, 3, k) [N], those first which shapes lack
        most, and whether these are all.
        """
        part, u = self.part, self.responses.solve(F)
        deformed = part.unmoved(np.einsum("ab,nbk->nak", self.Q, u[part.nodes]))
        forces = part.times_stiffness(deformed)
        own, whole = part.dot(deformed, forces), part.dot(F, u)
        h = part.dot(modes, forces)
        lack = own - h.T @ np.linalg.solve(stiffness, h)
        values, T = slowest(self.responses.scene.comm, lack)
        own, whole = (np.einsum("ki,kl,li->i", T, A, T) for A in (own, whole))
        bound = np.maximum(own, LACKING**2 * whole)
        some = values > np.maximum(LACKING**2 * bound, INDEPENDENT**2 * bound.max(initial=0.0))
        count = whole_groups(values[some], most)
        return np.asarray((F @ T[:, some])[:, :, :count]), count == np.count_nonzero(some)

    def destroy(self) -> None:
        """Free the PETSc objects of the body. Collective."""
        self.part.destroy()
        if "beside" in vars(self):
            self.beside.destroy()


class Excess:
    """The energy and the forces that an expansion misses at one displacement.

    Attributes:
        d: Φ q in the frame of the body, at its owned nodes, shape (nodes, 3) [m].
        nu: ν of all of it.
        missed: Part of the energy ½ e·Ωe by which that of the cells is larger.
        drawn: Coordinates by which forces of second order stretch it, where joints or springs may
            keep its ends apart, shape (m,) [m]; zero where nothing does.
    """

    def __init__(self, about: About, body: Body) -> None:
        """Evaluate where a body with shapes is. Collective.

        Cells beside it, which it strains as its sections turn, count as well.
        """
        part, shapes, self._scene = about.part, body.data.shapes, about.responses.scene
        assert shapes is not None
        self.d = deformed(body, body.motion.q)
        stretched, _ = body.stretched
        self._e = e = deformed(body, stretched)
        self._about, even = about, part.even(e, part.rolled(e))
        respond = about.responses.of_nodes(part.nodes, about.Q)
        free = deformed(body, shapes.free(body.motion.q))
        n = 0 if shapes.tension is None else len(shapes.tension)
        self._w = free + part.relief(shapes, n, even, respond)[1] + part.rolled(free)
        self.missed = float(self._scene.sum(part.missed(e, self._w).sum()))
        if shapes.selves is not None:
            self.missed -= (
                0.5 * float((shapes.selves.of(body.motion.q) ** 2).sum()) / part.energy(e)
            )
        energy = abs(self.missed) + about.beside.energy(self.d @ about.Q) / part.energy(e)
        left, modes = part.left_on(shapes, stretched, even), shapes.whole.swapaxes(1, 2)
        unseen = float(np.abs(part.swung(e, modes) / np.diag(shapes.stiffness)).max())
        self.nu = max(energy, 0.5 * abs(part.followed(shapes, left, e)), 0.5 * unseen)
        k, self.drawn = shapes.given if about.joined else len(left), np.zeros(len(left))
        self.drawn[k:] = np.linalg.solve(shapes.stiffness[k:, k:], left[k:])

    @cached_property
    def _lacking(self) -> Array:
        """Energy that each owned cell misses, over its volume [J/m³]. Collective.

        Cells beyond a leaf turn as it bends, and have none: it is the leaf that spends ν.
        """
        return self._about.part.lacking(self._e, self._w)

    def most(self, share: float) -> Indices:
        """Owned cells that miss more than a share of the largest miss, sorted. Collective."""
        largest = self._scene.comm.allreduce(float(self._lacking.max(initial=0.0)), op=MPI.MAX)
        return np.flatnonzero(self._lacking > share * largest).astype(np.int32)

    def within(self, cells: Indices) -> float:
        """The part of all misses that some owned cells would not have if they left. Collective.

        Where bends turn them, places that are linear in these stretch them: they would miss more.
        """
        weights = self._about.responses.stiffness.linear.strains.weights
        missed = weights * np.array([self._lacking, self._about.part.lacking(self._e, self.d)])
        here, there = self._scene.sum(missed[:, cells].sum(axis=1))
        return float(here / self._scene.sum(missed[0].sum())) if there < here else 0.0

    def spent(self, share: float) -> tuple[int, Array, Array]:
        """How many cells miss more than a share of the largest miss, and the box that they are in.

        It is where nothing is deformed, by two corners [m]. Collective.
        """
        scene, cells = self._scene, self.most(share)
        places = scene.space.tabulate_dof_coordinates()
        x = places[scene.space.dofmap.list[cells]].reshape(-1, 3)
        ends = np.stack([x.max(axis=0, initial=-np.inf), -x.min(axis=0, initial=np.inf)])
        scene.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
        return int(scene.sum(cells.size)), -ends[1], ends[0]


def deformed(body: Body, q: Array) -> Array:
    """Φ q at the owned nodes of a body, with the drift of one that is held, shape (nodes, 3)."""
    assert body.data.shapes is not None
    return np.asarray(q @ body.data.shapes.whole)


@dataclass(frozen=True)
class Unrelieved:
    """A small bend, and how its strains of second order are relieved."""

    q: Array  # coordinates of the bend, shape (m,) [m]
    on_shapes: Array  # h of shapes, shape (m,) [N]
    forces: Array  # h beside those, shape (nodes, 3) [N]
    away: Array  # w beside shapes, shape (nodes, 3) [m]
    rolled: Array  # by which bodies in it stay rigid, shape (nodes, 3) [m]

    @staticmethod
    def of(about: About, shapes: Shapes, *which: int) -> "Unrelieved":
        """That of the sum of some shapes of a body. Collective."""
        part, q = about.part, np.zeros(len(shapes))
        for j in which:
            q[j] += part.small / part.largest(shapes.whole[:, j])
        d = q @ shapes.whole
        rolled, respond = part.rolled(d), about.responses.of_nodes(part.nodes, about.Q)
        found = part.relief(shapes, len(shapes), part.even(d, rolled), respond)
        h = part.dot(shapes.whole.swapaxes(1, 2), part.lengthened(d)[:, :, None])[:, 0]
        return Unrelieved(q, h, *found, rolled)


def unrelieved(about: About, shapes: Shapes) -> list[Unrelieved]:
    """Those of the softest two shapes of a body that no support gives, and of both. Collective."""
    pairs = combinations_with_replacement(map(int, softest(shapes, 2)), 2)
    return [Unrelieved.of(about, shapes, *which) for which in pairs]


def softest(shapes: Shapes, count: int) -> Ints:
    """The softest shapes that no support gives."""
    own = np.diag(shapes.stiffness)[shapes.given :]
    return shapes.given + np.argsort(own, kind="stable")[:count]


def self_stresses(about: About, shapes: Shapes, bends: list[Unrelieved]) -> SelfStresses:
    """Those of some bends of a body. Collective."""
    part, modes = about.part, shapes.whole.swapaxes(1, 2)
    Q, h = (np.array(a) for a in zip(*((one.q, one.on_shapes) for one in bends), strict=True))
    forces, away = stacked(bends)
    rolled = np.stack([one.rolled for one in bends], axis=2)
    left = np.asarray(away + rolled - modes @ (shapes.flexibility @ h.T))
    each = zip(np.moveaxis(left, 2, 0), (q @ shapes.whole for q in Q), strict=True)
    V = np.concatenate([part.tension_by(w[:, :, None], modes, d) for w, d in each])
    own = np.einsum("ajk,bj,bk->ab", V, Q, Q) / 2
    every = own - part.dot(forces, away) + h @ shapes.flexibility @ h.T
    scale = np.sqrt(np.abs(np.diag(every)))
    comm = about.responses.scene.comm
    sizes, T = slowest(comm, every / np.outer(scale, scale))
    T = T[:, sizes > INDEPENDENT] / np.sqrt(sizes[sizes > INDEPENDENT]) / scale[:, None]
    shares, turn = slowest(comm, T.T @ own @ T)
    T = T @ turn[:, shares > LACKING] / np.sqrt(shares[shares > LACKING])
    V, squares = np.einsum("bjk,bs->sjk", V, T), np.einsum("bj,bk,bs->sjk", Q, Q, T)
    fields = np.einsum("nab,bs->nsa", left, T)
    return SelfStresses(shapes.nodes, V, np.zeros(len(V)), squares, fields)


def stacked(bends: list[Unrelieved]) -> tuple[Array, Array]:
    """Forces and displacements of bends, each (nodes, 3, bends) [N, m]."""
    forces, away = zip(*((one.forces, one.away) for one in bends), strict=True)
    return np.stack(forces, axis=2), np.stack(away, axis=2)
