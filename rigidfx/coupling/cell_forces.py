"""Forces of the flexible cells at the rows of their nodes, wherever copies of the cells are."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la

from rigidfx.coupling.prolongation import Prolongation
from rigidfx.flexible.kernels import add_vector

__all__ = ["CellForces"]

Array = npt.NDArray[np.float64]


class CellForces:
    """A linear form of the cells' forces, evaluated at displacements of rows."""

    def __init__(self, prolongation: Prolongation, form: fem.Form, u1: fem.Function) -> None:
        """Make room for what the cells tell. Collective.

        Args:
            prolongation: It knows whether cells are dealt.
            form: Over all cells that exert forces, or their copies.
            u1: Displacement at the end of the step, a coefficient of the form or of its original.
        """
        self._form, self._u1, self._dealt = form, u1, prolongation.dealt
        layout = prolongation.layout
        self._dofs = layout.rows.dofs
        # DOLFINx makes a new array of a vector each time that it is asked for one.
        self._of_u1 = u1.x.array
        if self._dealt is None:
            self._b = la.vector(layout.space.dofmap.index_map, 3)
            self._values, self._reached = self._b.array, layout.reached
        else:
            copy = self._dealt.cells.copy(u1)
            self._of_copy, self._values = copy.x.array, np.zeros(copy.x.array.size)

    def begin(self) -> None:
        """Begin a step: coefficients have what they have in it. Collective."""
        if self._dealt is not None:
            self._dealt.cells.refresh()

    def displace(self, u: Array) -> None:
        """Set u₁, with which tangents are assembled, too. Collective.

        Args:
            u: One number per row [m].
        """
        self._of_u1[self._dofs] = u
        self._u1.x.scatter_forward()
        if self._dealt is not None:
            self._of_copy[:] = self._dealt.give_nodes(u.reshape(-1, 3)).reshape(-1)

    def evaluate(self, out: Array) -> None:
        """The forces at u₁. Collective.

        Args:
            out: One number per row, overwritten [N].
        """
        if self._dealt is None:
            self._values[self._reached] = 0.0
            add_vector(self._values, self._form)
            self._b.scatter_reverse(la.InsertMode.add)
            out[:] = self._values[self._dofs]
        else:
            self._values[:] = 0.0
            add_vector(self._values, self._form)
            out[:] = self._dealt.add_up(self._values.reshape(-1, 3)).reshape(-1)
