"""Share of each node in an integral over cells or facets: masses, areas, forces of a load."""

from typing import Any, Literal

import numpy as np
import ufl
from dolfinx import fem, la

from rigidfx.base.form_cache import form_on
from rigidfx.base.types import Array, Indices
from rigidfx.effects import PointMass


def nodal_weights(
    space: fem.FunctionSpace, density: Any, kind: Literal["dx", "ds"], where: Indices
) -> Array:
    """∫ density Nᵢ, per local node with ghosts, shape (nodes,). Collective.

    Nᵢ are shape functions of a space of vectors. The integral is over owned cells (dx), or over
    facets (ds) by owned cells and the facets in them, shape (facets, 2).
    """
    mesh = space.mesh
    # Two degrees above the integrand of an affine cell, for cells that are not.
    degree = {"quadrature_degree": 2 * space.element.basix_element.degree + 2}
    data = [(1, where.reshape(-1))]
    measure = ufl.Measure(kind, domain=mesh, metadata=degree, subdomain_data=data)(1)
    along_x = ufl.dot(ufl.as_vector((1.0, 0.0, 0.0)), ufl.TestFunction(space))
    out = fem.Function(space)
    fem.assemble_vector(out.x.array, form_on(mesh.comm, density * along_x * measure))
    out.x.scatter_reverse(la.InsertMode.add)
    out.x.scatter_forward()
    return np.asarray(out.x.array[::3].copy())


def point_masses(scene: Any) -> Array:
    """Sum of the point masses of all effects, per local node with ghosts [kg]. Collective."""
    total = np.zeros(len(scene.start_places))
    for effect in scene.effects:
        own = effect.nodal_mass(scene)
        total += 0.0 if own is None else own
    return total


def inertial_masses(scene: Any) -> Array:
    """Nodal masses, those of bodies of given mass scaled to it, per owned node [kg]. Collective.

    A given mass stands for all lumped mass on the nodes of a body, and has its centre. Of a
    consistent mass, cells beside the body keep their shares of nodes that they have in common.
    """
    n = scene.owned_nodes
    total = scene.nodal_mass[:n].copy()
    for effect in scene.effects:
        if not effect.is_rigid or effect.mass is None:
            continue
        inside = scene.nodes(effect.where, "Rigid", (3,))
        own: Array = np.zeros(len(scene.nodal_mass))
        own[inside] = scene.nodal_mass[inside]
        if scene.mass == "consistent":
            cells = scene.owned_cells(effect.where, "Rigid")
            points = np.where(own != 0.0, scene.point_masses, 0.0)
            own = scene.cell_weights(scene.density(), cells) + points
        total += own[:n] * (float(effect.mass) / scene.sum(own[:n].sum()) - 1.0)
    for effect in scene.named(PointMass):
        if effect.face is not None:
            total[effect.remote.place.nodes] += effect.mass * effect.remote.place.weights
    return np.asarray(total)
