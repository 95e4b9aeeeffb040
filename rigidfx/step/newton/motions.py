"""The rigid motions of the free parts of a layout: they hardly strain."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.mechanics.rigid_motions import rigid_motions

__all__ = ["EMPTY", "motions_of_unknowns"]


EMPTY = 1e-12  # squared norm of a motion that nothing takes part in, relative to the largest


def motions_of_unknowns(prolongation: Prolongation, x: Array) -> Array:
    """An orthonormal basis of the unknowns' rigid motions. Collective.

    Args:
        prolongation: Map between unknowns and dofs.
        x: Positions of the active nodes, shape (nodes, 3) [m].

    Returns:
        Shape (owned unknowns, motions): six, fewer where supports leave none of some.
    """
    increments = prolongation.increments
    own = prolongation.moving
    comm = prolongation.comm
    sums = np.append(x.sum(axis=0), len(x))
    comm.Allreduce(MPI.IN_PLACE, sums)
    middle = sums[:3] / max(sums[3], 1.0)
    out = np.zeros((prolongation.owned, 6))
    nodes, axis = np.nonzero(prolongation.free_of_nodes)
    moved = rigid_motions(prolongation.at_nodes(x)[nodes] - middle, 1.0)
    out[np.arange(nodes.size), :6] = moved[np.arange(nodes.size), axis]
    six = np.zeros((own.size, 6, 6))  # Δr and ℓθ of each body, by motions
    six[:, :3] = rigid_motions(increments.start.r[own] - middle, 1.0)
    six[:, 3:, 3:] = np.eye(3) * increments.start.of.length[own, None, None]
    out[prolongation.six] = six
    gram = out.T @ out
    comm.Allreduce(MPI.IN_PLACE, gram)
    squares, vectors = np.linalg.eigh(gram)
    kept = squares > EMPTY * squares[-1]
    return np.asarray(out @ (vectors[:, kept] / np.sqrt(squares[kept])))
