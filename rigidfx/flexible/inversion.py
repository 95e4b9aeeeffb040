"""Flexible cells turned inside out: found before a solution is accepted.

A step whose end has det F ≤ 0 at an integration point is no motion of a body, but nothing in the
equations says so: stored energies see C = FᵀF only, and that of St.Venant and Kirchhoff does not
even resist. Nothing stops a hyperelastic cell under an unbounded load either, until its energy
overflows. The check costs 0.7 % and 0.5 % of a step (hexahedra, 4·10³ and 27·10³ unknowns).
"""

from dataclasses import dataclass

import dolfinx.mesh as dmesh
import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from rigidfx.base.types import Array
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.flexible.kernels import Kernel, add_vector
from rigidfx.scene.scene import Scene

LARGEST_STRETCH = 1e6  # beyond it a cell counts as torn apart


@dataclass(frozen=True)
class InvertedCells:
    """Cells turned inside out or torn apart; the same on all ranks."""

    count: int  # how many cells
    number: int  # number in the mesh file of the first of them
    place: Array  # its middle in the reference configuration, shape (3,) [m]

    def __str__(self) -> str:
        """Which cells, for messages."""
        x, y, z = self.place
        first = f"cell {self.number} of the mesh around X = ({x:.6g}, {y:.6g}, {z:.6g}) m"
        return first if self.count == 1 else f"{self.count} of them, the first one {first}"


class Inversion:
    """Looks for cells with det F ≤ 0, or stretched a million times, among those it is bound to."""

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        """Compile the form at u₁, the end of a step. Collective."""
        self._mesh, self._comm = scene.mesh, scene.comm
        space = scene.cell_space
        dx, F = scene.cell_measure, scene.element.deformation_gradient(forces.u1)
        sound = ufl.And(ufl.gt(ufl.det(F), 0.0), ufl.lt(ufl.inner(F, F), LARGEST_STRETCH**2))
        turned = ufl.conditional(sound, 0.0, 1.0)
        self._kernel = Kernel(turned * ufl.TestFunction(space) * dx(1), [space], scene.mesh)
        self._volume = fem.Function(space)  # inside out, of each cell [m³]
        self._dofs = space.dofmap.list[:, 0]

    def bind(self, flexible: Cells) -> None:
        """Look at these owned cells from now on."""
        self._cells = np.sort(np.concatenate([np.empty(0, np.int32), *flexible.values()]))
        self._form = self._kernel.bind({1: self._cells})
        self._own = self._dofs[self._cells]

    def find(self) -> InvertedCells | None:
        """The cells that u₁ turns inside out; None if there are none. Collective."""
        volume = self._volume.x.array
        volume[self._own] = 0.0
        add_vector(volume, self._form)
        cells = self._cells[volume[self._own] > 0]
        count = self._comm.allreduce(cells.size, op=MPI.SUM)
        if count == 0:
            return None
        numbers = self._mesh.topology.original_cell_index[cells]
        mine = None
        if cells.size:
            first = cells[[np.argmin(numbers)]]
            mine = int(numbers.min()), dmesh.compute_midpoints(self._mesh, 3, first)[0]
        found = [item for item in self._comm.allgather(mine) if item is not None]
        number, place = min(found, key=lambda item: item[0])
        return InvertedCells(count, number, place)
