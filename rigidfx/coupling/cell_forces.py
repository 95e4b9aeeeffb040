"""Forces of the flexible cells at the rows of their nodes, wherever copies of the cells are."""

import numpy as np
from dolfinx import fem, la

from rigidfx.base.types import Array
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.kernels import add_vector


class CellForces:
    """A linear form of the cells' forces, evaluated at displacements of rows."""

    def __init__(self, prolongation: Prolongation, form: fem.Form, forces: InternalForces) -> None:
        """Make room for the results of cells that exert forces, or of their copies. Collective."""
        self._form, self._forces, self._dealt = form, forces, prolongation.dealt
        layout = prolongation.layout
        self._dofs = layout.rows.dofs
        # DOLFINx makes a new array of a vector each time that it is asked for one.
        self._u1 = forces.u1.x.array
        if self._dealt is None:
            self._b = la.vector(layout.space.dofmap.index_map, 3)
            self._values, self._reached = self._b.array, layout.reached
        else:
            u0, u1 = (self._dealt.cells.copy(u) for u in (forces.u0, forces.u1))
            self._copies, self._values = (u0.x.array, u1.x.array), np.zeros(u1.x.array.size)

    def begin(self, u: Array) -> None:
        """Begin a step at u₀, one number per row [m], which coefficients hold in it. Collective."""
        if self._dealt is not None:
            forces = self._forces
            self._dealt.cells.refresh((forces.u0, forces.u1, forces.rest))
            self._copies[0][:] = self._dealt.give_nodes(u.reshape(-1, 3)).reshape(-1)

    def displace(self, u: Array) -> None:
        """Set u₁ by rows [m], for forces and tangents; ghosts by `settle`. Collective."""
        self._u1[self._dofs] = u
        if self._dealt is None:
            self._forces.u1.x.scatter_forward()
        else:
            self._copies[1][:] = self._dealt.give_nodes(u.reshape(-1, 3)).reshape(-1)

    def settle(self) -> None:
        """Share the last u₁ in the scene's mesh among ranks, as forms over that read it, too."""
        if self._dealt is not None:
            self._forces.u1.x.scatter_forward()

    def evaluate(self, out: Array) -> None:
        """Overwrite `out` by the forces at u₁, one number per row [N]. Collective."""
        if self._dealt is None:
            self._values[self._reached] = 0.0
            add_vector(self._values, self._form)
            self._b.scatter_reverse(la.InsertMode.add)
            out[:] = self._values[self._dofs]
        else:
            self._values[:] = 0.0
            add_vector(self._values, self._form)
            out[:] = self._dealt.add_up(self._values.reshape(-1, 3)).reshape(-1)
