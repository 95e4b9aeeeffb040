"""Who moves how: free dofs, dofs that supports prescribe, nodes that rigid bodies move.

A layout is made once for a set of flexible cells, bodies and supports, and everything a step
works on is sized by it. A node that belongs to a body and to a flexible cell is *attached*: the
flexible cells pull at it, the body moves it. The other nodes of a body are of no concern to a step:
they have no rows, and cost nothing.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from petsc4py import PETSc

from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.coupling.rows import Rows
from rigidfx.flexible.internal_forces import Cells
from rigidfx.mechanics.bodies import Ensemble
from rigidfx.mechanics.rigid_body import RigidBody, outside
from rigidfx.scene.scene import Scene


@dataclass(frozen=True)
class DofLayout:
    """A division of cells and dofs."""

    space: Any  # function space of the displacement
    flexible: Cells  # flexible owned cells by subdomain id
    interior: Cells  # those of them that touch no body
    interface: Cells  # those that do
    ensemble: Ensemble  # data of the rigid bodies
    # For each body, which of its nodes are attached (positions in body.nodes)
    attached: tuple[Indices, ...]
    # For each owned dof, whether a support prescribes it, shape (3 · owned nodes,)
    prescribed: Bools
    free: Bools  # for each owned dof, whether it is an unknown
    massive: Bools  # for each owned node, whether its inertia is its own and not a body's
    rows: Rows  # those of the active nodes, owned ones outside bodies or attached
    masses: Array  # lumped mass of each active node that is its own [kg]
    # Local dofs, ghosts included, of flexible and driven cells of any rank: forms over these read
    # and write them
    reached: Ints
    # For each body, which of its nodes have its velocity: all of them with a lumped mass, else
    # those that no flexible cell touches, as the flexible cells' side of an interface has a
    # velocity of its own
    following: tuple[Indices, ...]

    @property
    def bodies(self) -> tuple[RigidBody, ...]:
        """The bodies' data, one by one."""
        return self.ensemble.records


def dof_layout(
    scene: Scene,
    flexible: Cells,
    ensemble: Ensemble,
    prescribed: Bools,
    driven: Cells | None = None,
) -> DofLayout:
    """Divide the dofs of a scene between flexible owned cells and bodies. Collective.

    No two bodies share a node. For each owned dof, `prescribed` says whether a support has it;
    `driven` are owned cells that a support moves.
    """
    n = scene.owned_nodes
    touched = nodes_of(scene, flexible)
    reached = touched if driven is None else touched | nodes_of(scene, driven)
    massive = outside(n, ensemble.records)
    interior, interface = split(scene, flexible, np.flatnonzero(~massive))
    attached = tuple(np.flatnonzero(touched[b.nodes]).astype(np.int32) for b in ensemble.records)
    whole = [np.arange(b.nodes.size, dtype=np.int32) for b in ensemble.records]
    lumped = scene.mass == "lumped"
    inside = (np.setdiff1d(own, at) for own, at in zip(whole, attached, strict=True))
    active = np.flatnonzero(massive | touched[:n]).astype(np.int32)
    return DofLayout(
        space=scene.space,
        flexible=flexible,
        interior=interior,
        interface=interface,
        ensemble=ensemble,
        attached=attached,
        prescribed=prescribed,
        free=np.repeat(massive, 3) & ~prescribed,
        massive=massive,
        rows=Rows(scene.space, active),
        masses=np.where(massive, scene.nodal_mass[:n], 0.0)[active],
        reached=np.flatnonzero(np.repeat(reached, 3)),
        following=tuple(whole if lumped else inside),
    )


def rigid_fields(scene: Scene, ensemble: Ensemble, prescribed: Bools) -> DofLayout:
    """A division in which all nodes of bodies are attached and no cell is flexible.

    It serves fields over the whole mesh that are rigid in the bodies.
    """
    n = scene.owned_nodes
    free = outside(n, ensemble.records)
    whole = tuple(np.arange(body.nodes.size, dtype=np.int32) for body in ensemble.records)
    return DofLayout(
        space=scene.space,
        flexible={},
        interior={},
        interface={},
        ensemble=ensemble,
        attached=whole,
        prescribed=prescribed,
        free=np.repeat(free, 3) & ~prescribed,
        massive=free,
        rows=Rows(scene.space, np.arange(n, dtype=np.int32)),
        masses=np.where(free, scene.nodal_mass[:n], 0.0),
        reached=np.empty(0, np.int64),
        following=whole,
    )


def nodes_of(scene: Scene, cells: Cells) -> Bools:
    """Which local nodes belong to the given cells of any rank. Collective."""
    mark = fem.Function(scene.space)
    for group in cells.values():
        nodes = scene.space.dofmap.list[group].reshape(-1)
        mark.x.array[3 * nodes] = 1.0
    mark.x.scatter_reverse(la.InsertMode.add)
    mark.x.scatter_forward()
    return mark.x.array[::3] > 0


def split(scene: Scene, flexible: Cells, of_bodies: Ints) -> tuple[Cells, Cells]:
    """Interior and interface cells: without and with owned nodes of bodies. Collective."""
    mark = fem.Function(scene.space)
    mark.x.array[3 * of_bodies] = 1.0
    mark.x.scatter_forward()
    of_body = mark.x.array[::3] > 0
    dofs = scene.space.dofmap.list
    touching = {i: of_body[dofs[cells]].any(axis=1) for i, cells in flexible.items()}
    return (
        {i: cells[~touching[i]] for i, cells in flexible.items()},
        {i: cells[touching[i]] for i, cells in flexible.items()},
    )


class AtNodes:
    """Passes numbers at nodes between ranks."""

    def __init__(self, scene: Scene) -> None:
        """Make a field for them. Collective."""
        self._x = fem.Function(scene.space).x
        self._owned = scene.owned_nodes

    def largest(self, nodes: Indices, values: Array) -> Array:
        """At each local node the largest value of cells, of any rank, round it. Collective.

        Owned cells have nodes of the shape (cells, nodes of a cell). It is minus infinity where
        there is none.
        """
        x = self._x
        x.array[:] = -np.inf
        np.maximum.at(x.array, 3 * nodes.reshape(-1), np.repeat(values, nodes.shape[1]))
        x.petsc_vec.ghostUpdate(addv=PETSc.InsertMode.MAX, mode=PETSc.ScatterMode.REVERSE)
        x.scatter_forward()
        return x.array[::3].copy()

    def of_owners(self, values: npt.NDArray[np.generic]) -> Array:
        """Numbers of owned nodes, as numbers of all local nodes. Collective."""
        x = self._x
        x.array[::3][: self._owned] = values
        x.scatter_forward()
        return x.array[::3].copy()
