"""How far a body is from the expansion that its shapes have, and where: ν.

It is the largest of three parts,

    |V(w) - ½ d·K d|/(½ d·K d) ,    ½ |e·M d|/d·M d ,    e = Φ Ω⁻¹ Φᵀ g ,    ½ |ΔΩ|/Ω ,

of the energy and of the displacement d = Φq. e is the response of the shapes to the forces g of
second order. A bar in tension is stiffer as it bends, which may be little of the energy of the
tension and much of the bend.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array, Indices
from rigidfx.mechanics.rigid_body import Body
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
        for vector in vectors(own.scene):
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
        self._w = part.whole(free, part.beyond(shapes, even), respond) + part.rolled(free)
        energy = abs(float(self._scene.sum(part.missed(e, self._w).sum())))
        energy += about.beside.energy(self.d @ about.Q) / part.energy(e)
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
