"""Strains that a motion adds to a shape, in cells that are asked for."""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from rigidfx.base.types import Array, Indices
from rigidfx.flexible.indicator import Indicator
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.scene.scene import Scene


def finite(values: Array, comm: MPI.Intracomm) -> Array:
    """Values, if they are finite on all ranks. Collective.

    Raises:
        LinAlgError: On every rank, if they are not.
    """
    if comm.allreduce(bool(np.isfinite(values).all()), op=MPI.LAND):
        return values
    raise np.linalg.LinAlgError("numbers are not finite")


class CellStrains:
    """Measures the strain that a motion adds to a shape, in cells that are asked for."""

    def __init__(self, scene: Scene, forces: InternalForces, indicator: Indicator) -> None:
        """Measure nothing yet. Collective.

        Args:
            scene: The problem.
            forces: Internal forces, which know the cells of each material.
            indicator: A measure of its own.
        """
        self._comm, self._forces, self._indicator = scene.comm, forces, indicator
        self._ends = fem.Function(scene.space), fem.Function(scene.space)
        self._cells: Indices | None = None

    def of(self, motion: Array, span: float, shape: fem.Function, cells: Indices) -> Array:
        """Strain by a motion, over a time. Collective.

        Args:
            motion: Of the owned nodes, in the frame of the shape, shape (nodes, 3) [m].
            span: The time [s]; 1 for a strain.
            shape: Displacement that makes the shape [m].
            cells: Owned cells.

        Returns:
            Linear strain of each of the cells [1/s], in their order.

        Raises:
            LinAlgError: On every rank, if the motion is not finite.
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
