"""Dashpots in place of the flexible cells round bodies: what a body's vibration loses to them.

The force on a body is that of its neighbours beside a body that moves rigidly. Were it flexible,
they would give way, and its vibration would run out into them. A shadow without that rings on where
the structure has come to rest, and where they move it at one of its own frequencies nothing bounds
it. What they would do is known in the mean: averaged over frequencies, the impedance of a structure
is that of one without an end (E. Skudrzyk, J. Acoust. Soc. Am. 67 (1980) 1105-1135), a dashpot ρcA
at an interface of area A (J. Lysmer, R. L. Kuhlemeyer, J. Eng. Mech. Div. 95 (1969) 859-877). Here

    c_i = sqrt(k_i m_i)

at each node that flexible cells share with a body, k_i the mean of their three stiffnesses there
and m_i their mass there: ρcA/√2 for a bar of first-order cells, whatever their size. One number
per node holds in any frame.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx.fem import petsc as fem_petsc

from rigidfx.coupling.rows import Rows
from rigidfx.flexible.internal_forces import Cells
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.step.stepper import Stepper

__all__ = ["of_neighbours"]

Array = npt.NDArray[np.float64]


def of_neighbours(stepper: Stepper, rows: Rows, cells: Cells, linear: LinearForms) -> Array:
    """Constants of the dashpots at nodes that cells share with shadows. Collective.

    Args:
        stepper: Solves the steps.
        rows: Those of the shadows' nodes.
        cells: Owned flexible cells by subdomain id; others of no concern may be among them.
        linear: Forms, undeformed.

    Returns:
        One for each node of the rows [N s/m].
    """
    scene = stepper.scene
    form = linear.stiffness(cells)
    K = rows.matrix(form)
    fem_petsc.assemble_matrix(K, form)
    K.assemble()
    diagonal = K.getDiagonal()
    k = diagonal.array.reshape(-1, 3).mean(axis=1)
    diagonal.destroy()
    K.destroy()
    every = np.concatenate([np.empty(0, np.int32), *cells.values()])
    m = scene.cell_weights(scene.density(), np.sort(every))[rows.nodes]
    return np.sqrt(np.maximum(k * m, 0.0))
