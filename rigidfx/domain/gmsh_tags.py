"""Mesh files of version 2 whose cells have one elementary number for all of their groups.

In these files each cell and facet has the number of its physical group and one of its elementary
entity, and gmsh takes a group for all entities in which one of its cells lies. Converters that know
groups only, such as meshio, give all the same entity: all groups would hold everything then. Each
group is made an entity of its own in such a file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.domain.gmsh_groups import Header

__all__ = ["separate_groups"]


def separate_groups(gmsh: Any, path: str | Path, header: Header) -> None:
    """Open a file anew with its groups as entities, if entities do not tell its groups apart.

    Args:
        gmsh: The module; the file is open in its current model.
        path: The file.
        header: Names of groups by dimension and number.

    Raises:
        SceneError: If that would lose cells that are in several groups.
    """
    if not _is_of_version_2(path):
        return
    shared = [e for e in gmsh.model.getEntities() if _groups_of(gmsh.model, e) > 1]
    times = [(_times(gmsh.model, *e), _groups_of(gmsh.model, e)) for e in shared]
    if all(there == groups for there, groups in times):
        return  # a cell is there once for each of its groups: these do overlap
    if any(there != 1 for there, _ in times):
        raise SceneError(
            f"'{path}' has one elementary number for several physical groups, of which some hold "
            "the same cells or facets, so that it does not say which group holds which. Save it in "
            "version 4.1 of gmsh's format, or without groups that overlap."
        )
    gmsh.option.setNumber("Mesh.SwitchElementTags", 1)
    gmsh.open(str(path))
    model = gmsh.model
    model.removePhysicalGroups()
    for dim, number in model.getEntities():
        if len(model.mesh.getElements(dim, number)[0]):
            model.addPhysicalGroup(dim, [number], number, header.get((dim, number), ""))


def _is_of_version_2(path: str | Path) -> bool:
    with open(path, "rb") as file:
        file.readline()
        return file.readline().lstrip().startswith(b"2")


def _groups_of(model: Any, entity: tuple[int, int]) -> int:
    return len(model.getPhysicalGroupsForEntity(*entity))


def _times(model: Any, dim: int, number: int) -> float:
    """How often the cells of an entity are there, in the mean."""
    kinds, numbers, nodes = model.mesh.getElements(dim, number)
    total = different = 0
    for _, each, flat in zip(kinds, numbers, nodes, strict=True):
        rows = np.sort(flat.reshape(len(each), -1), axis=1)
        total += len(rows)
        different += len(np.unique(rows, axis=0))
    return total / max(different, 1)
