"""The energy of a part beside the expansion of second order that its shapes have.

With d = Φ q the displacement by shapes and w = d + δ, where δ is the response of second order,
δ = -K⁻¹(½ [f(d) + f(-d)] - f(0)), and with forces f and energy V of the cells about the shape,

    ν = |V(w) - V(0) - f(0)·w - ½ d·K d| / (½ d·K d).

The energy is that of the corrected place: a shape that bends a leaf stretches it by the square of
the rotation, which the structure relieves.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from rigidfx.error.linear_motion import assembled
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.shapes.part import Part
from rigidfx.shapes.responses import Responses
from rigidfx.shapes.stiffness import times

__all__ = ["Excess"]

Array = npt.NDArray[np.float64]


class Excess:
    """The expansion of a part at one displacement.

    Attributes:
        energy: ½ d·K d [J].
        nu: ν of the whole part.
    """

    def __init__(self, responses: Responses, forces: InternalForces, part: Part, d: Array) -> None:
        """Evaluate. Collective.

        Args:
            responses: Of the whole structure.
            forces: Internal forces, which know the energy of each material.
            part: The part.
            d: Displacement by shapes at its owned nodes, shape (nodes, 3) [m].
        """
        self._scene, self._stiffness = responses.scene, responses.stiffness
        self._forces, self._part, self._d = forces, part, d
        F = np.zeros((self._scene.owned_nodes, 3, 1))
        even = 0.5 * (self._internal(d) + self._internal(-d))
        at_rest = self._internal(0 * d)
        F[part.nodes, :, 0] = at_rest - even
        w = d + part.unmoved(responses.solve(F))[:, :, 0]
        self.energy = 0.5 * self._sum(d * part.times_stiffness(d[:, :, None])[:, :, 0])
        gained = self._energy(w) - self._energy(0 * d)
        work = self._sum(at_rest * w)
        self.nu = abs(gained - work - self.energy) / self.energy

    def _sum(self, values: Array) -> float:
        return float(self._scene.sum(values.sum()))

    @contextmanager
    def _displaced(self, d: Array) -> Iterator[fem.Function]:
        """Displace the shape by d. Collective."""
        made, nodes = self._stiffness.linear.shape, self._part.nodes
        before = made.x.array.copy()
        made.x.array[: 3 * self._scene.owned_nodes].reshape(-1, 3)[nodes] += d
        made.x.scatter_forward()
        yield made
        made.x.array[:] = before

    def _internal(self, d: Array) -> Array:
        """Forces at the part's nodes, shape (nodes, 3) [N]. Collective."""
        with self._displaced(d):
            return self._stiffness.internal_forces(self._part.cells)[self._part.nodes]

    def _energy(self, d: Array) -> float:
        """Stored energy [J]. Collective."""
        with self._displaced(d) as made:
            form = self._forces.bind_energy(self._part.cells, made)
            return float(self._scene.sum(fem.assemble_scalar(form)))

    def spent(self) -> tuple[int, Array, Array]:
        """A box with two thirds of ½ d·K d or more, halved as long as one half has. Collective.

        Cells beyond a leaf turn as it bends, and part from the expansion by that alone: it is the
        leaf that spends ν.

        Returns:
            Number of its cells, and the corners of their box where nothing is deformed, shapes
            (3,) and (3,) [m].
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
        """½ d·K d of some of its cells [J]. Collective."""
        rows, d = self._part.rows, self._d.reshape(-1, 1)
        K = assembled(rows, self._stiffness.linear.tangent(cells))
        image = times(K, d, rows.vector)
        K.destroy()
        return 0.5 * self._sum(d * image)
