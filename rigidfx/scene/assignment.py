"""Which material each cell has: exactly one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
from rigidfx.base.taken import read_only
from rigidfx.base.types import Indices
from rigidfx.domain.domain import Domain
from rigidfx.mechanics.materials import Material
from rigidfx.scene.energy_checks import check_energy

__all__ = ["assign"]


def assign(
    domain: Domain, material: Material | Mapping[str, Material]
) -> tuple[tuple[Material, Indices], ...]:
    """Materials with their owned cells. Collective.

    Args:
        domain: Mesh and names.
        material: One material, or one for each of the named sets that make up the mesh.

    Raises:
        SceneError: If a name or a material is none, a cell has no material or several, or a stored
            energy cannot be formed.
    """
    owned = domain.mesh.topology.index_map(3).size_local
    used = material.values() if isinstance(material, Mapping) else [material]
    for item in used:
        if isinstance(item, Material):
            check_energy(domain, item)
    if isinstance(material, Material):
        return ((material, read_only(np.arange(owned, dtype=np.int32))),)
    if not isinstance(material, Mapping) or not material:
        raise SceneError(
            f"Scene: material must be a Material or a dict of cell-set names to materials, "
            f"got {shown(material)}."
        )
    times_used = np.zeros(owned, dtype=np.int32)
    pairs = []
    if not all(isinstance(name, str) for name in material):
        raise SceneError(
            f"Scene: materials are given by names of cell sets, got {shown(material)}."
        )
    # The sets are looked up on all ranks at a time, and a dict may be ordered otherwise on each.
    names = domain.comm.bcast(list(material))
    for name in names:
        m = material[name]
        if not isinstance(m, Material):
            raise SceneError(f"Scene: the material of '{name}' must be a Material, got {shown(m)}.")
        entities = domain.find(name, (3,), "Scene (material)").entities
        cells = entities[entities < owned]
        times_used[cells] += 1
        pairs.append((m, read_only(cells)))
    none, several = (
        int(domain.comm.allreduce(int(np.count_nonzero(c))))
        for c in (times_used == 0, times_used > 1)
    )
    if none or several:
        raise SceneError(
            f"Scene: every cell needs exactly one material; {none} cells have none and {several} "
            f"have several{_examples(domain, times_used, dict(zip(names, pairs, strict=True)))}. "
            f"Known names: {domain.names}."
        )
    return tuple(pairs)


def _examples(
    domain: Domain,
    times_used: Indices,
    given: Mapping[str, tuple[Material, Indices]],
) -> str:
    """A cell without a material, and one with several and their names, by their places."""
    wrong = [np.flatnonzero(found)[:1] for found in (times_used == 0, times_used > 1)]
    mesh, texts = domain.mesh, []
    for kind, cells in zip(("without one", "in"), wrong, strict=True):
        mine = ""
        if cells.size:
            place = mesh.geometry.x[cell_geometry_dofs(mesh)[cells[0]]].mean(axis=0)
            sets = " and ".join(f"'{n}'" for n, (_, own) in given.items() if cells[0] in own)
            mine = f"{kind} {sets}".rstrip() + ", around ({:.4g}, {:.4g}, {:.4g}) m".format(*place)
        texts += [next(filter(None, domain.comm.allgather(mine)), "")]
    return ": one " + "; one ".join(filter(None, texts))
