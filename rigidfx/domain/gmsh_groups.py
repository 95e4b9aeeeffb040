"""Physical groups of gmsh's models: the meaning of their names.

gmsh lets a face or a volume be in several groups, DOLFINx's tags hold one number per cell or facet.
So the groups are replaced, before the mesh is handed over, by one for each elementary entity, and a
name then stands for the entities of its group.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.text_files import decoded
from rigidfx.domain.domain import KINDS

# gmsh's numbers of the cells that DOLFINx and rigidfx know, and of their facets.
KNOWN = {4: "tetrahedra", 5: "hexahedra", 11: "second-order tetrahedra", 12: "27-node hexahedra"}
FACETS = {4: 2, 5: 3, 11: 9, 12: 10}

SHOWN = 10  # numbers of volumes in a message
UNLISTED = 1000  # numbers, from 1 and from the last group's on, at which empty ones are looked for

Names = dict[tuple[int, str], Any]
Header = Mapping[tuple[int, int], str]  # names by dimension and number


def names_in_header(path: str | Path) -> dict[tuple[int, int], str]:
    """Names that the header of a .msh file declares.

    gmsh keeps only the first of several equal ones in files of version 2.
    """
    found: dict[tuple[int, int], str] = {}
    with open(path, "rb") as file:
        if not file.readline().startswith(b"$MeshFormat"):
            return found
        inside = False
        for line in file:
            if line.startswith((b"$EndPhysicalNames", b"$Entities", b"$Nodes")):
                break
            inside = inside or line.startswith(b"$PhysicalNames")
            match = re.match(rb'\s*([0-3])\s+(\d+)\s+"(.*)"\s*$', line) if inside else None
            if match:
                found[int(match[1]), int(match[2])] = decoded(match[3])
    return found


def _groups(model: Any, header: Header) -> list[tuple[int, str, int]]:
    """Dimension, name and number of each physical group, empty ones included."""
    filled = set(model.getPhysicalGroups())
    last = max((tag for _, tag in {*filled, *header}), default=0)
    # gmsh lists groups with elements only, but knows the names of others; it counts from the last
    likely = {*range(1, UNLISTED), *range(last + 1, last + UNLISTED)}
    some = {(dim, tag) for dim in KINDS for tag in likely}
    groups = []
    for dim, tag in sorted(filled | set(header) | some):
        name = name_of(model.getPhysicalName, dim, tag) or header.get((dim, tag), "")
        if name or (dim, tag) in filled:
            groups.append((dim, name or f"{KINDS[dim]}-{tag}", tag))
    # Names of MED files have 80 letters, the last ones blanks; others may differ by a blank only.
    short = [(dim, name.rstrip()) for dim, name, _ in groups]
    if len(set(short)) < len(short):
        return groups
    return [(dim, name.rstrip(), tag) for dim, name, tag in groups]


def name_of(call: Callable[[int, int], str], dim: int, tag: int) -> str:
    """A name that gmsh tells, also where it is not in UTF-8."""
    try:
        return call(dim, tag)
    except UnicodeDecodeError as error:
        return decoded(error.object)


def take_groups(gmsh: Any, source: str, header: Header) -> tuple[Names, int]:
    """Give gmsh's model one group per entity; find the entities of each name.

    Without any group, all volumes are named "body".

    Args:
        gmsh: The module; its model is meshed.
        source: Where it comes from, for messages.
        header: Names of groups by dimension and number, for those that gmsh does not tell.

    Returns:
        By dimension and name, numbers of entities, or for dimensions 0, 1 numbers from 0 of the
        nodes at the corners of their elements, shape (elements, corners); and the number of volume
        cells that are in no group.

    Raises:
        SceneError: If a name is there twice, or cells or facets are of no kind that will do.
    """
    model = gmsh.model
    groups = _groups(model, header)
    if not groups and model.getEntities(3):
        model.addPhysicalGroup(3, [e for _, e in model.getEntities(3)], name="body")
        groups = _groups(model, header)
    listed = ", ".join(f"'{name}' ({KINDS[dim]})" for dim, name, _ in groups) or "none"
    _check_names(source, groups, listed)
    filled = set(model.getPhysicalGroups())
    entities = {
        (dim, name): model.getEntitiesForPhysicalGroup(dim, tag).tolist()
        if (dim, tag) in filled
        else []
        for dim, name, tag in groups
    }
    # Files of version 2 hold a cell once for each of its groups.
    model.mesh.removeDuplicateElements()
    kind = _kind_of_cells(model, source, entities, listed)
    _check_facets(model, source, kind, entities)
    model.removePhysicalGroups()
    used = {(dim, e) for (dim, _), own in entities.items() if dim >= 2 for e in own}
    for dim, tag in sorted(used):
        if len(model.mesh.getElements(dim, tag)[0]):
            model.addPhysicalGroup(dim, [tag], tag=tag)
    cells = {(3, e): _cells(model, e) for _, e in model.getEntities(3)}
    outside = {volume: n for volume, n in cells.items() if n and volume not in used}
    if outside:
        model.mesh.clear([*outside])
    # DOLFINx takes numbers without gaps only, of the nodes of groups; a script may ask for others.
    gmsh.option.setNumber("Mesh.SaveAll", 0)
    model.mesh.renumberNodes()
    corners = {
        key: _corners(model, key[0], own, key[0] + 1).astype(np.int64) - 1
        for key, own in entities.items()
        if key[0] < 2
    }
    return {**entities, **corners}, sum(outside.values())


def _corners(model: Any, dim: int, entities: Sequence[int], count: int) -> Any:
    """Numbers of the nodes at the corners of all elements, shape (elements, count)."""
    rows = [np.empty((0, count), np.uint64)]
    for e in entities:
        for _, elements, nodes in zip(*model.mesh.getElements(dim, e), strict=True):
            rows.append(nodes.reshape(len(elements), -1)[:, :count])
    return np.concatenate(rows)


def _cells(model: Any, volume: int) -> int:
    """Number of cells of a volume."""
    return sum(len(numbers) for numbers in model.mesh.getElements(3, volume)[1])


def _why_none(model: Any, entities: Mapping[tuple[int, str], list[int]]) -> str:
    """Why no group holds cells, and the remedy."""
    volumes = [e for _, e in model.getEntities(3)]
    if not volumes:
        return f"There is no volume at all, only {len(model.getEntities(2))} surfaces."
    meshed = [e for e in volumes if _cells(model, e)]
    if not meshed:
        return (
            "Its volumes are not meshed: generate the mesh in 3D before (gmsh -3, "
            "gmsh.model.mesh.generate(3))."
        )
    empty = [f"'{name}'" for dim, name in entities if dim == 3]
    why = f"That of {', '.join(empty)} holds none; " if empty else ""
    some = ", ".join(map(str, meshed[:SHOWN])) + (", …" if len(meshed) > SHOWN else "")
    group = f'Physical Volume("body") = {{{some}}};'
    return f"{why}{'t' if why else 'T'}o name the cells that there are: {group}"


def _advice(kinds: str) -> str:
    """The remedy for bricks of 20 nodes, and for wedges of extruded triangles; else empty."""
    if "Hexahedron 20" in kinds:
        return (
            " Bricks of 20 nodes have none in their faces and middle; gmsh gives them these with "
            "Mesh.SecondOrderIncomplete = 0 before Mesh.ElementOrder = 2 (or setOrder(2)). Or mesh "
            "with order 1 and let the scene be of second order (order=2)."
        )
    if "Prism" not in kinds:
        return ""
    return (
        " Wedges come from triangles that are extruded in layers: recombine them to quadrilaterals "
        "before (Mesh.RecombineAll = 1 with Mesh.Algorithm = 8, or Recombine Surface) and mesh "
        "anew, for hexahedra; or extrude without recombine (Recombine in scripts), for tetrahedra."
    )


def _check_names(source: str, groups: Sequence[tuple[int, str, int]], listed: str) -> None:
    """Refuse a name of several groups."""
    numbers: dict[tuple[int, str], list[int]] = {}
    for dim, name, tag in groups:
        numbers.setdefault((dim, name), []).append(tag)
    doubled = {key: tags for key, tags in numbers.items() if len(tags) > 1}
    if doubled:
        (dim, name), tags = next(iter(doubled.items()))
        raise SceneError(
            f"{source} gives the name '{name}' to several groups of {KINDS[dim]}, numbers "
            f"{', '.join(map(str, tags))}. Give each group its own name. Physical groups there: "
            f"{listed}."
        )


def _kind_of_cells(
    model: Any, source: str, entities: Mapping[tuple[int, str], list[int]], listed: str
) -> int:
    """gmsh's number of the one kind of cells there is; facets that are not theirs are refused."""
    volumes = {e for (dim, _), own in entities.items() if dim == 3 for e in own}
    kinds = {int(k) for e in volumes for k in model.mesh.getElements(3, e)[0]}
    if not kinds:
        raise SceneError(
            f"{source} has no physical group of volume cells (dimension 3) with cells in it, "
            f"which are what a domain is made of. {_why_none(model, entities)} Physical groups "
            f"there: {listed}."
        )
    if len(kinds) > 1 or not kinds <= set(KNOWN):
        raise SceneError(
            f"{source} has volume cells of these kinds: {_shown(model, kinds)}. A domain takes one "
            f"kind, out of {', '.join(KNOWN.values())}.{_advice(_shown(model, kinds))}"
        )
    kind = kinds.pop()
    facet = FACETS[kind]
    for (dim, name), own in entities.items():
        of_facets = {int(k) for e in own for k in model.mesh.getElements(dim, e)[0]}
        if dim == 2 and not of_facets <= {facet}:
            raise SceneError(
                f"{source}: the facets '{name}' are of these kinds: {_shown(model, of_facets)}. "
                f"Facets of the volume cells there are of the kind {_shown(model, {facet})}."
            )
    return kind


def _check_facets(
    model: Any, source: str, kind: int, entities: Mapping[tuple[int, str], list[int]]
) -> None:
    """Refuse facets that bound no cell of the mesh; DOLFINx would end all ranks over them.

    Raises:
        SceneError: With the names that have such facets.
    """
    corners = model.mesh.getElementProperties(FACETS[kind])[5]
    surfaces = {e for (dim, _), own in entities.items() if dim == 2 for e in own}
    facets = {e: _corners(model, 2, [e], corners) for e in surfaces}
    if not facets:
        return
    wanted = np.sort(np.concatenate(list(facets.values())), axis=1)
    volumes = {e for (dim, _), own in entities.items() if dim == 3 for e in own}
    sides = np.concatenate(
        [model.mesh.getElementFaceNodes(kind, corners, e, primary=True) for e in volumes]
    ).reshape(-1, corners)
    sides = np.sort(sides[np.isin(sides, wanted).all(axis=1)], axis=1)
    _, which = np.unique(np.concatenate([sides, wanted]), axis=0, return_inverse=True)
    which = which.reshape(-1)
    loose = ~np.isin(which[len(sides) :], which[: len(sides)])
    ends = np.cumsum([len(rows) for rows in facets.values()])[:-1]
    lost = {e: int(own.sum()) for e, own in zip(facets, np.split(loose, ends), strict=True)}
    wrong = [
        f"'{name}' ({sum(lost[e] for e in own)} of {sum(len(facets[e]) for e in own)})"
        for (dim, name), own in entities.items()
        if dim == 2 and any(lost[e] for e in own)
    ]
    if wrong:
        raise SceneError(
            f"{source}: of the facets {', '.join(wrong)} bound no volume cell of the mesh, which "
            "is made of the cells in physical groups. Leave them out of the group, or put the "
            "volume that they bound into one."
        )


def _shown(model: Any, kinds: set[int]) -> str:
    return ", ".join(model.mesh.getElementProperties(k)[0] for k in sorted(kinds))
