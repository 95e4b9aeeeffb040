"""Vectors made orthonormal by a mass, one after another, so that their order decides."""

from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array

# Part of a vector's size that is to be left once all earlier ones are taken out of it. Solves leave
# 3e-6 of the deformation where soft springs let a plate move by 3e4 times as much, 1e-9 in others;
# a load's response may lack 0.01.
INDEPENDENT = 1e-5
# Relative distance of eigenvalues that may be one, as of the two bending modes of a square bar.
APART = 1e-6


class Basis:
    """Vectors Y at this rank's nodes with YᵀMY = 1 and their images MY, shape (nodes, 3, n)."""

    def __init__(
        self,
        nodes: int,
        total: Callable[[Array], Array],
        anew: Callable[[Array], tuple[Array, Array]],
    ) -> None:
        """Begin without vectors at this rank's nodes. Collective.

        `total` is a sum over ranks; `anew` takes out motions that none may have, and gives images.
        """
        self.vectors, self.images = np.zeros((2, nodes, 3, 0))
        self._total, self._anew = total, anew

    def __len__(self) -> int:
        return int(self.vectors.shape[2])

    def grow(self, vectors: Array, images: Array, sizes: Array, most: int) -> None:
        """Add those of some vectors that are not dependent on earlier ones. Collective.

        Vectors have the shape (nodes, 3, k), and `INDEPENDENT` of the size of each by the mass has
        to be left. The basis is full at `most` vectors. The rest has the errors of earlier ones,
        as many times larger as it is small: it is cleaned before others are taken from it.
        """
        shape, n, k = vectors.shape[:2], len(self), vectors.shape[2]
        room = min(n + k, max(most, n))
        Y, MY = np.empty((2, room, 3 * shape[0])).swapaxes(1, 2)  # a vector lies in a row
        Y[:, :n], MY[:, :n] = columns(self.vectors), columns(self.images)
        more, of_more = (np.array(columns(of), order="F") for of in (vectors, images))
        m = n
        parts = self._total(MY[:, :n].T @ more)
        more -= Y[:, :n] @ parts
        of_more -= MY[:, :n] @ parts
        for k, size in enumerate(sizes):
            if n == room:
                break
            y, image = more[:, k], of_more[:, k]
            parts = self._total(MY[:, m:n].T @ y)
            y -= Y[:, m:n] @ parts
            image -= MY[:, m:n] @ parts
            left = float(np.sqrt(max(float(self._total(y @ image)), 0.0)))
            if left > INDEPENDENT * size:
                y /= left
                y, image = (u.ravel() for u in self._anew(y.reshape(*shape, 1)))
                parts = self._total(MY[:, :n].T @ y)
                y, image = y - Y[:, :n] @ parts, image - MY[:, :n] @ parts
                left = float(np.sqrt(self._total(y @ image)))
                Y[:, n], MY[:, n] = y / left, image / left
                n += 1
        self.vectors, self.images = (A[:, :n].reshape(*shape, n) for A in (Y, MY))


def columns(u: Array) -> Array:
    """Vectors of the shape (nodes, 3, k) as the columns of a matrix, shape (3 nodes, k)."""
    return u.reshape(3 * len(u), u.shape[2])


def normalised(u: Array, gram: Array) -> Array:
    """Independent vectors, (nodes, 3, k), made orthonormal by their products, shape (k, k)."""
    return np.linalg.solve(np.linalg.cholesky(gram), columns(u).T).T.reshape(u.shape)


def to_one(comm: MPI.Intracomm, u: Array) -> tuple[Array, Array]:
    """Vectors with 1 as the largest displacement of each, and that before. Collective."""
    before = largest(comm, u)
    return np.asarray(u / before), before


def largest(comm: MPI.Intracomm, u: Array) -> Array:
    """The largest displacement of each vector, (nodes, 3, k). Collective."""
    out = np.linalg.norm(u, axis=1).max(axis=0, initial=0.0)
    comm.Allreduce(MPI.IN_PLACE, out, op=MPI.MAX)
    return np.asarray(out)


def slowest(comm: MPI.Intracomm, flexibility: Array) -> tuple[Array, Array]:
    """Eigenvalues and eigenvectors of a symmetric matrix, the largest first. Collective.

    Ranks have the same matrix, shape (k, k), but for rounding.
    """
    values, vectors = comm.bcast(np.linalg.eigh(0.5 * (flexibility + flexibility.T)))
    return values[::-1], vectors[:, ::-1]


def whole_groups(values: Array, most: int) -> int:
    """How many eigenvalues, the largest first, up to a limit, parting none that may be one.

    Vectors of such a group are any that span the same, as rounding has it.
    """
    count = min(values.size, most)
    while 0 < count < values.size and values[count] > (1 - APART) * values[count - 1]:
        count -= 1
    return count
