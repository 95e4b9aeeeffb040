"""Which way hexahedra are thin: through the facets of a surface, and on behind it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import la
from mpi4py import MPI

from rigidfx.base.errors import agree
from rigidfx.domain.domain import Domain

__all__ = ["thickness_axes"]

Axes = npt.NDArray[np.int8]

# Facets of a hexahedron k and 5 - k are opposite, across the coordinates
ACROSS = np.array([2, 1, 0, 0, 1, 2])


def thickness_axes(domain: Domain, name: str) -> Axes:
    """The coordinate of each local cell across its thickness, 1 to 3; 0 where it has none.

    Collective.

    Args:
        domain: A mesh of hexahedra.
        name: Facets; from each of them the thickness goes on facet by opposite facet.

    Raises:
        SceneError: On every rank, if the name is unknown, or two directions meet in a cell.
    """
    found = domain.find(name, (2,), "AssumedStrains")
    topology = domain.mesh.topology
    topology.create_connectivity(3, 2)
    facets = topology.connectivity(3, 2).array.reshape(-1, 6)
    marks = la.vector(topology.index_map(2), 1, dtype=np.float64)
    marks.array[found.entities] = 1.0
    count = 0
    while True:
        _share(marks)
        now = int(np.count_nonzero(marks.array))
        grown = domain.comm.allreduce(now - count, op=MPI.MAX)
        if grown == 0:
            break
        count = now
        hit = marks.array[facets] > 0
        marks.array[facets[hit[:, ::-1]]] = 1.0
    hit = marks.array[facets] > 0
    across = np.stack([hit[:, k] | hit[:, 5 - k] for k in range(3)], axis=1)  # of facets 0, 1, 2
    several = domain.comm.allreduce(int(np.count_nonzero(across.sum(axis=1) > 1)))
    agree(
        domain.comm,
        f"AssumedStrains: through '{name}' the thickness goes two ways in some cells. Name one "
        "side of the thin part, without its rim."
        if several
        else None,
    )
    axes = np.where(across.any(axis=1), ACROSS[np.argmax(across, axis=1)] + 1, 0)
    return np.asarray(axes, dtype=np.int8)


def _share(marks: la.Vector) -> None:
    """Mark a facet on all ranks that know it. Collective."""
    marks.scatter_reverse(la.InsertMode.add)
    marks.array[:] = marks.array > 0
    marks.scatter_forward()
