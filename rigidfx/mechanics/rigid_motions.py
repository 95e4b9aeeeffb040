"""The rigid motions of places of a body: which are free, and which rows determine them."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from scipy.linalg import null_space, qr

from rigidfx.base.types import Array, Bools, Ints

__all__ = ["RIGID", "free_motions", "independent", "rigid_motions", "spanning"]


RIGID = 1e-6  # part of a body's length by which places on a line may be off it


def rigid_motions(places: Array, length: float | Array) -> Array:
    """Rigid motions of places of a body, shape (places, 3, 6); rotations as lengths.

    Args:
        places: Relative to the centre, shape (places, 3) [m].
        length: By which rotations are multiplied [m]; one number, or shape (places, 1).
    """
    modes = np.zeros((len(places), 3, 6))
    modes[:, :, :3] = np.eye(3)
    modes[:, :, 3:] = np.cross(np.eye(3)[:, None], places / length).transpose(1, 2, 0)
    return modes


def free_motions(places: Array, held: Bools, length: float, comm: MPI.Intracomm) -> Array:
    """The rigid motions of a body that supports do not prevent. Collective.

    Args:
        places: Of nodes that would move with it, relative to its centre [m], shape (nodes, 3).
        held: Which components of these are held, likewise.
        length: Its length [m].
        comm: The scene's.

    Returns:
        An orthonormal basis of them, shape (6, motions).
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


def spanning(places: Array, length: float) -> Ints:
    """Some of a body's places that tell how all of it moves, six at most.

    Args:
        places: Of nodes, shape (nodes, 3) [m].
        length: Length of the body [m].
    """
    return np.unique(independent(rigid_motions(places, length).reshape(-1, 6)) // 3)
