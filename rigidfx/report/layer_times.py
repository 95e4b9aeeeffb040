"""Times of the layer of cells behind a contact: what a mesh resolves of a blow, and by which Δt.

Nodes are s apart across the layer, whose waves have the speed c = √((λ + 2μ)/ρ). A wave crosses it
in s/c. Forces that vary within few crossings are those of a lattice of nodes and not of the body: a
lattice of masses and springs that hits a rigid wall has 1.47 ρ c v at first (∫ J₀), and nodes ring
on a stiff penalty up to more than 2 ρ c v. `resolved_time` is `CROSSINGS` of them.

The layer, of mass ρ s, leaves its stiffness (λ + 2μ)/s and the penalty's k in series after half a
period, π (s/c) √(1 + (λ + 2μ)/(k s)). A part that is named rigid has its whole mass on the
stiffness of all its nodes in the surface, in series with the layer of the other surface.
`own_time` is the shortest of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.types import Array
from rigidfx.effects.contacts.surface import area_vectors, modulus_of, surface_of, triangles_of
from rigidfx.effects.rigid import Rigid

__all__ = ["own_time", "resolved_time"]


CROSSINGS = 4.0  # of a layer: a mean over them is ρ c v of a flat face within a few per cent


def resolved_time(scene: Any, contact: Any) -> float:
    """Four crossings of the layer behind a contact, the slower one of two [s]. Collective.

    It is a mean over the surface; 0 if only rigid parts are behind.
    """
    return CROSSINGS * max(_mean(scene, _layer(scene, contact, w)[0]) for w in _sides(contact))


def own_time(scene: Any, contact: Any) -> float:
    """The shortest half period of a contact's layers, in their mean, and rigid parts. Collective.

    Returns:
        The time [s]; inf if neither a modulus nor a rigid part is known.
    """
    surface = surface_of(scene, contact.where, contact.stiffness, contact.owner)
    k, area = scene.sum([of[: scene.owned_nodes].sum() for of in (surface.stiffness, surface.area)])
    times, softness, lightest = [np.inf], 0.0, np.inf
    for where in _sides(contact):
        crossing, layer = _layer(scene, contact, where)
        times.append(np.pi * _mean(scene, crossing * np.sqrt(1.0 + layer * area / k)) or np.inf)
        if where != contact.where:
            lightest = min((m for m, _ in _rigid(scene, contact, where)), default=np.inf)
            softness = _mean(scene, 1.0 / layer) if lightest == np.inf else 0.0
    for m, on in _rigid(scene, contact, contact.where):
        stiffness = on / (area / k + softness)
        times.append(np.pi / np.sqrt(stiffness * (1.0 / m + 1.0 / lightest)))
    return float(min(times))


def _sides(contact: Any) -> tuple[str, ...]:
    """Names of the surfaces that meet."""
    return tuple(dict.fromkeys(contact.keeps_apart)) or (contact.where,)


def _mean(scene: Any, values: npt.NDArray[Any]) -> float:
    """Mean over ranks; 0 of nothing. Collective."""
    total, count = scene.sum([values.sum(), values.size])
    return float(total / max(count, 1.0))


def _layer(scene: Any, contact: Any, where: str) -> tuple[Array, Array]:
    """Time s/c [s] and stiffness (λ + 2μ)/s [N/m³] at each triangle of a surface. Collective.

    Triangles on rigid parts, and on cells of a material that tells no modulus, are left out.
    """
    cells, nodes = triangles_of(scene, where, contact.owner)
    X, dofs = scene.space.tabulate_dof_coordinates(), scene.space.dofmap.list
    modulus, density = np.zeros((2, len(dofs)))
    for material, own in scene.materials:
        modulus[own], density[own] = modulus_of(scene.comm, material), material.rho
    for rigid in (effect for effect in scene.named(Rigid) if effect.is_rigid):
        modulus[scene.owned_cells(rigid.where, rigid.kind)] = np.nan
    known = np.isfinite(modulus[cells])
    cells, corners = cells[known], X[nodes[known]]
    normal = area_vectors(corners)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    from_it = X[dofs[cells]] - corners.mean(axis=1)[:, None]
    s = np.abs(np.einsum("nij,nj->ni", from_it, normal)).max(axis=1, initial=0.0) / scene.order
    return s * np.sqrt(density[cells] / modulus[cells]), modulus[cells] / s


def _rigid(scene: Any, contact: Any, where: str) -> list[tuple[float, float]]:
    """Mass [kg] and area [m²] of each part named rigid that has nodes in a surface. Collective."""
    area = surface_of(scene, where, contact.stiffness, contact.owner).area
    found = []
    for rigid in (effect for effect in scene.named(Rigid) if effect.is_rigid):
        inside = np.zeros(area.size, dtype=bool)
        inside[slice(None) if rigid.where is None else scene.nodes(rigid.where, "Rigid", (3,))] = 1
        inside[scene.owned_nodes :] = False
        pressed, m = scene.sum([area[inside].sum(), scene.nodal_mass[inside].sum()])
        if pressed > 0:
            found.append((m if rigid.mass is None else float(rigid.mass), pressed))
    return found
