"""How far a part is from the expansion that its shapes have, and where."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array
from rigidfx.flexible.internal_forces import Cells
from rigidfx.flexible.surface import SMALL_WAY
from rigidfx.shapes.interface import Interface
from rigidfx.shapes.part import Part
from rigidfx.shapes.responses import Responses


class Excess:
    """The expansion of a part at one displacement, with ½ d·K d [J] and ν of the whole part."""

    def __init__(self, responses: Responses, part: Part, d: Array) -> None:
        """Evaluate at d by shapes, at the part's owned nodes, shape (nodes, 3) [m]. Collective."""
        self._scene, self._part, self._d = responses.scene, part, d
        self.energy = part.energy(d)
        w = part.whole(d, responses.of_nodes(part.nodes))
        beside = Interface(responses.stiffness, part.cells, part.nodes)
        self.nu = abs(float(self._scene.sum(part.missed(d, w).sum())))
        self.nu += beside.energy(d) / self.energy
        beside.destroy()

    def spent(self) -> tuple[int, Array, Array]:
        """A box with two thirds of ½ d·K d or more, halved as long as one half has. Collective.

        Cells beyond a leaf turn as it bends, and part from the expansion by that alone: it is the
        leaf that spends ν. Number of its cells, and the corners of their box where nothing is
        deformed [m].
        """
        scene, cells = self._scene, self._part.cells
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
            most = [half for half in halves if 3 * self._in(half) > 2 * self.energy]
            count = int(scene.sum(sum(len(own) for own in cells.values())))
            if len(most) != 1 or count == 1:
                return count, lower, upper
            (cells,) = most

    def _in(self, cells: Cells) -> float:
        """½ d·K d of some of its cells, by their forces at ± a small part of d [J]. Collective."""
        scene, forces = self._scene, self._part.forces
        size = scene.comm.allreduce(float(np.abs(self._d).max(initial=0.0)), op=MPI.MAX)
        h = SMALL_WAY * scene.mean_cell_size / size
        change = forces(h * self._d, cells) - forces(-h * self._d, cells)
        return 0.25 * float(scene.sum((self._d * change).sum())) / h
