"""The rigid motions of places of a body: which are free, and which fits best or is determined."""

from collections.abc import Callable

import numpy as np
from mpi4py import MPI
from scipy.linalg import null_space, qr

from rigidfx.base.types import Array, Bools, Ints
from rigidfx.mechanics.rotation import nearest_rotations

RIGID = 1e-6  # part of a body's length by which places on a line may be off it


def rigid_motions(places: Array, length: float | Array) -> Array:
    """Rigid motions of places about a centre [m], (places, 3, 6), with turns times lengths."""
    modes = np.zeros((len(places), 3, 6))
    modes[:, :, :3] = np.eye(3)
    modes[:, :, 3:] = np.cross(np.eye(3)[:, None], places / length).transpose(1, 2, 0)
    return modes


def best_motion(
    before: Array, after: Array, total: Callable[[Array], Array]
) -> tuple[Array, Array]:
    """Rotation and shift that take places best to others (W. Kabsch, Acta Cryst. A 32 (1976) 922).

    Both are this rank's, shape (places, 3) [m]; `total` sums over the ranks. Collective.
    """
    local = [len(before), *before.sum(axis=0), *after.sum(axis=0), *(after.T @ before).ravel()]
    sums = total(np.array(local))
    count, x, y = max(sums[0], 1.0), sums[1:4], sums[4:7]
    R = nearest_rotations(sums[7:].reshape(3, 3) - np.outer(y, x) / count)
    return R, (y - R @ x) / count


def fitted_motion(
    modes: Array, values: Array, total: Callable[[Array], Array], mass: float | Array = 1.0
) -> Array:
    """Coefficients of the motions that fit values best, in the mean of squares, shape (k, n).

    This rank's rows are (rows, k) and (rows, n), and a mass per row weighs squares. Collective.
    """
    sums = np.asarray(total((mass * modes).T @ np.c_[modes, values]))
    k = modes.shape[1]
    return np.asarray(np.linalg.lstsq(sums[:, :k], sums[:, k:])[0])


def free_motions(places: Array, held: Bools, length: float, comm: MPI.Intracomm) -> Array:
    """The rigid motions of a body that supports do not prevent, orthonormal. Collective.

    Places [m], relative to the centre, and held components are of nodes that would move with it,
    shape (nodes, 3); motions have the shape (6, motions).
    """
    own = rigid_motions(places, length)[held]
    prevented = np.concatenate(comm.allgather(own[independent(own)]))
    return null_space(prevented, rcond=RIGID) if len(prevented) else np.eye(6)


def independent(modes: Array) -> Ints:
    """As many rows as there are columns, at most, that are as independent as can be.

    By QR with pivoting.
    """
    if not modes.size:
        return np.empty(0, np.int64)
    _, order = qr(modes.T, mode="r", pivoting=True)
    return np.asarray(order[: modes.shape[1]], dtype=np.int64)


def determining(motions: Array, comm: MPI.Intracomm) -> Ints:
    """Rows of motions of this rank, (rows, k), which with those of others determine all k.

    They are sorted, and k of all ranks at most. Collective.
    """
    own = independent(motions)
    every = comm.allgather(motions[own])
    chosen = independent(np.concatenate(every))
    first = sum(len(rows) for rows in every[: comm.rank])
    mine = chosen[(chosen >= first) & (chosen < first + own.size)] - first
    return np.sort(own[mine])
