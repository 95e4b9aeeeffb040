"""Strain rates of the flexible cells in a step: equation (24).

Both measures come from ∫ ΔE:ΔE dV0 per cell, E the Green-Lagrange strain, by the quadrature rule of
the internal forces. Rigid motion changes neither E nor, therefore, either measure.
"""

from typing import Literal, Protocol

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from rigidfx.base.form_cache import form_on
from rigidfx.base.types import Array, Indices
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.flexible.kernels import Kernel, add_vector
from rigidfx.scene.scene import Scene


class Indicator(Protocol):
    """A measure of flexible cells in a step.

    Attributes:
        cells: Owned cells that are measured, sorted.
        values: Number of each owned cell in the last step, zero where none is measured.
        weights: ∫ Ė:Ė dV of each owned cell over its number squared, [m³] for strain rates.
    """

    @property
    def cells(self) -> Indices:
        """Owned cells that are measured, sorted."""
        ...

    @property
    def values(self) -> Array:
        """Number of each owned cell."""
        ...

    @property
    def weights(self) -> Array:
        """Weight of the square of each number."""
        ...

    def bind(
        self, flexible: Cells, between: tuple[fem.Function, fem.Function] | None = None
    ) -> None:
        """Measure these owned cells from now on, between u₀ and u₁ or other displacements."""
        ...

    def measure(self, dt: float) -> Array:
        """Measure the bound cells in the step that the forms' u₀ and u₁ hold, in their order."""
        ...

    def strains(self) -> Array:
        """The integral over time that the bound cells would have of it, from no displacement on.

        That is of each owned cell, zero where none is measured, at the forms' u₀.
        """
        ...


class StrainRates:
    """Measures strain rates of the cells it is bound to."""

    def __init__(
        self, scene: Scene, forces: InternalForces, measure: Literal["rms", "paper"]
    ) -> None:
        """Compile the form, of a measure as of `StrainRate`. Collective."""
        self._forces = forces
        space = scene.cell_space
        dx, C = scene.cell_measure, scene.element.right_cauchy_green
        dE = (C(forces.u1) - C(forces.u0)) / 2
        form = ufl.inner(dE, dE) * ufl.TestFunction(space) * dx(tuple(forces.cells()))
        self._kernel = Kernel(form, [space], scene.mesh)
        self._square = fem.Function(space)
        self._nowhere = fem.Function(scene.space)
        self._dofs = space.dofmap.list[:, 0]
        self._power = 1 if measure == "rms" else 2
        self._volume = _volumes(space)[self._dofs]
        self.values = np.zeros(scene.mesh.topology.index_map(3).size_local)
        self.weights = self._volume[: self.values.size] ** self._power

    def bind(
        self, flexible: Cells, between: tuple[fem.Function, fem.Function] | None = None
    ) -> None:
        """Measure these owned cells from now on; all others have the strain rate zero.

        Cells that were bound before keep the strain rate of the last step. Displacements between
        which is measured may replace u₀ and u₁.
        """
        ends = dict(zip((self._forces.u0, self._forces.u1), between or (), strict=False))
        self._form = self._kernel.bind(flexible, instead=ends)
        nowhere, u = self._nowhere, ends.get(self._forces.u0, self._forces.u0)
        instead = {self._forces.u0: nowhere, self._forces.u1: u}
        self._whole = self._kernel.bind(flexible, instead=instead)
        self.cells = np.sort(np.concatenate([np.empty(0, np.int32), *flexible.values()]))
        self._own = self._dofs[self.cells]
        self._divisor = self._volume[self.cells] ** (self._power / 2)
        others = np.ones(self.values.size, dtype=bool)
        others[self.cells] = False
        self.values[others] = 0.0

    def measure(self, dt: float) -> Array:
        """Strain rates of the bound cells in the step that u₀ and u₁ hold, in their order [1/s]."""
        rates = np.asarray(self._integrated(self._form) / dt)
        self.values[self.cells] = rates
        return rates

    def strains(self) -> Array:
        """Strain at u₀ of each owned cell, by the same measure; zero where none is bound."""
        out = np.zeros_like(self.values)
        out[self.cells] = self._integrated(self._whole)
        return out

    def _integrated(self, form: fem.Form) -> Array:
        """Strain of the bound cells between the ends of a form."""
        square = self._square.x.array
        square[self._own] = 0.0
        add_vector(square, form)
        return np.asarray(np.sqrt(square[self._own]) / self._divisor)


def _volumes(space: fem.FunctionSpace) -> Array:
    """V0 of each local cell [m³], by the number of its unknown in the space."""
    volume = fem.Function(space)
    form = form_on(space.mesh.comm, ufl.TestFunction(space) * ufl.dx)
    fem.assemble_vector(volume.x.array, form)
    return volume.x.array.copy()


def finite(values: Array, comm: MPI.Intracomm) -> Array:
    """Values, if they are finite on all ranks; else a `LinAlgError` on all. Collective."""
    if comm.allreduce(bool(np.isfinite(values).all()), op=MPI.LAND):
        return values
    raise np.linalg.LinAlgError("numbers are not finite")


class CellStrains:
    """Measures the strain that a motion adds to a shape, in cells that are asked for."""

    def __init__(self, scene: Scene, forces: InternalForces, indicator: Indicator) -> None:
        """Measure nothing yet, by an indicator of its own. Collective."""
        self._comm, self._forces, self._indicator = scene.comm, forces, indicator
        self._ends = fem.Function(scene.space), fem.Function(scene.space)
        self._cells: Indices | None = None

    def of(self, motion: Array, span: float, shape: fem.Function, cells: Indices) -> Array:
        """Linear strain of owned cells by a motion, over a time span [1/s]. Collective.

        The motion of the owned nodes is in the frame of a shape, (nodes, 3) [m]. One that is not
        finite is a `LinAlgError` on every rank.
        """
        if self._cells is None or not np.array_equal(cells, self._cells):
            self._cells = np.array(cells, dtype=np.int32)
            self._indicator.bind(self._forces.cells(np.unique(self._cells)), self._ends)
        motion = finite(motion, self._comm)
        start, end = (f.x for f in self._ends)
        # Between half of the motion on either side the part of second order is zero.
        for side, half in ((start, -0.5), (end, 0.5)):
            side.array[:] = shape.x.array
            side.array[: motion.size] += half * motion.reshape(-1)
            side.scatter_forward()
        self._indicator.measure(span)
        return np.asarray(self._indicator.values[self._cells])
