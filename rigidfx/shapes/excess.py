"""How far a body is from the expansion that its shapes have, and where: ν.

It is the larger one of two parts,

    |V(w) - ½ d·K d|/(½ d·K d)    and    ½ |e·M d|/d·M d ,    e = Φ Ω⁻¹ Φᵀ g ,

of the energy and of the displacement d = Φq. e is the response of the shapes to the forces g of
second order. A bar in tension is stiffer as it bends, which may be little of the energy of the
tension and much of the bend.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array, Bools, Indices
from rigidfx.coupling.dof_layout import nodes_of
from rigidfx.flexible.internal_forces import Cells
from rigidfx.flexible.surface import SMALL_WAY
from rigidfx.mechanics.rigid_body import Body
from rigidfx.mechanics.shapes import ShapesOfBodies
from rigidfx.shapes.expanded import Expanded
from rigidfx.shapes.interface import Interface
from rigidfx.shapes.orthonormal import INDEPENDENT, slowest, whole_groups
from rigidfx.shapes.part import LACKING, MOST
from rigidfx.shapes.responses import Responses


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
    """

    def __init__(self, about: About, body: Body) -> None:
        """Evaluate where a body with shapes is. Collective.

        Cells beside it, which it strains as its sections turn, count as well.
        """
        part, shapes, self._scene = about.part, body.data.shapes, about.responses.scene
        assert shapes is not None
        self.d = deformed(body, body.motion.q)
        stretched, _ = body.stretched
        e = deformed(body, stretched)
        self._about, self._energy, even = about, part.energy(e), part.even(e)
        on_shapes = part.dot(shapes.whole.swapaxes(1, 2), even[:, :, None])[:, 0]
        respond = about.responses.of_nodes(part.nodes, about.Q)
        free = deformed(body, shapes.free(body.motion.q))
        w = part.whole(free, part.beyond(shapes, even), respond)
        missed = part.missed(e, w)
        self._dense = np.abs(missed) / self._scene.averaging_mass[part.nodes]
        energy = abs(float(self._scene.sum(missed.sum())))
        energy += about.beside.energy(self.d @ about.Q) / self._energy
        left = on_shapes - ShapesOfBodies([shapes]).even_force(stretched[None])[0]
        self.nu = max(energy, 0.5 * abs(part.followed(shapes, left, e)))

    def most(self, share: float) -> Bools:
        """The nodes of the body that miss more than a share of the largest miss. Collective."""
        here = float(self._dense.max(initial=0.0))
        return np.asarray(self._dense > share * self._scene.comm.allreduce(here, op=MPI.MAX))

    def within(self, cells: Indices) -> float:
        """The part of all misses that nodes of some owned cells have. Collective."""
        inside = nodes_of(self._scene, {0: cells})[self._about.part.nodes]
        missed = self._dense * self._scene.averaging_mass[self._about.part.nodes]
        here, every = self._scene.sum([missed[inside].sum(), missed.sum()])
        return float(here / every)

    def spent(self) -> tuple[int, Array, Array]:
        """A box with two thirds of ½ d·K d or more, halved as long as one half has. Collective.

        Cells beyond a leaf turn as it bends, and part from the expansion by that alone: it is the
        leaf that spends ν. Number of its cells, and the corners of their box where nothing is
        deformed [m].
        """
        scene, cells = self._scene, self._about.part.cells
        X = scene.space.tabulate_dof_coordinates()
        while True:
            nodes = {i: X[scene.space.dofmap.list[own]] for i, own in cells.items()}
            every = np.concatenate([x.reshape(-1, 3) for x in nodes.values()])
            lower, upper = every.min(axis=0, initial=np.inf), every.max(axis=0, initial=-np.inf)
            scene.comm.Allreduce(MPI.IN_PLACE, lower, op=MPI.MIN)
            scene.comm.Allreduce(MPI.IN_PLACE, upper, op=MPI.MAX)
            axis, middle = int(np.argmax(upper - lower)), 0.5 * (lower + upper)
            first = {i: x.mean(axis=1)[:, axis] < middle[axis] for i, x in nodes.items()}
            halves = [
                {i: own[first[i] == side] for i, own in cells.items()} for side in (True, False)
            ]
            most = [half for half in halves if 3 * self._in(half) > 2 * self._energy]
            count = int(scene.sum(sum(len(own) for own in cells.values())))
            if len(most) != 1 or count == 1:
                return count, lower, upper
            (cells,) = most

    def _in(self, cells: Cells) -> float:
        """½ d·K d of some of its cells, by their forces at ± a small part of d [J]. Collective."""
        scene, forces = self._scene, self._about.part.forces
        size = scene.comm.allreduce(float(np.abs(self.d).max(initial=0.0)), op=MPI.MAX)
        h = SMALL_WAY * scene.mean_cell_size / size
        change = forces(h * self.d, cells) - forces(-h * self.d, cells)
        return 0.25 * float(scene.sum((self.d * change).sum())) / h


def deformed(body: Body, q: Array) -> Array:
    """Φ q at the owned nodes of a body, with the drift of one that is held, shape (nodes, 3)."""
    assert body.data.shapes is not None
    return np.asarray(q @ body.data.shapes.whole)
