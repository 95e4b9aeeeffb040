"""Physical groups of gmsh's models: the meaning of their names.

A name stands for the cells, or for the corners of the facets, edges and points, of all elementary
entities of its group, and a face or a volume may be in several groups.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rigidfx.base import compat
from rigidfx.base.errors import SceneError
from rigidfx.base.files import decoded
from rigidfx.domain.arrays import FileMesh
from rigidfx.domain.domain import KINDS

# gmsh's numbers of the cells that DOLFINx and rigidfx know.
KNOWN = {4: "tetrahedra", 5: "hexahedra", 11: "second-order tetrahedra", 12: "27-node hexahedra"}
CELL = {"Tetrahedron": "tetrahedron", "Hexahedron": "hexahedron"}  # by gmsh's names
FACET = {"Tetrahedron": "Triangle", "Hexahedron": "Quadrangle"}

SHOWN = 10  # numbers of volumes in a message
UNLISTED = 1000  # numbers, from 1 and from the last group's on, at which empty ones are looked for

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


def mesh_of_model(gmsh: Any, source: str, header: Header, scale: float) -> FileMesh:
    """The mesh of gmsh's model, with the names of its groups and those of a file's header.

    Without any group, all volumes are named "body". A name that is there twice is refused, and so
    are kinds of cells and facets that DOLFINx does not have.
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
    tags, flat, _ = model.mesh.getNodes()
    number = np.empty(int(tags.max()) + 1, dtype=np.int64)
    number[np.sort(tags)] = np.arange(len(tags))
    name, _, _, width, *_ = model.mesh.getElementProperties(kind)
    cell = CELL[name.split()[0]]
    volumes = sorted({e for (dim, _), own in entities.items() if dim == 3 for e in own})
    tables = [number[_nodes(model, 3, [e], width)] for e in volumes]
    ends = np.cumsum([0, *map(len, tables)])
    rows = {e: np.arange(*ends[k : k + 2]) for k, e in enumerate(volumes)}
    order = compat.gmsh_order(cell, width)
    points = scale * np.reshape(flat, (-1, 3))[np.argsort(tags)]
    mesh = FileMesh(cell, points, np.concatenate(tables)[:, order])
    corners = {2: model.mesh.getElementProperties(_facet(model, kind))[5], 1: 2, 0: 1}
    for (dim, name), own in entities.items():
        mesh.sets[dim][name] = (
            np.concatenate([ends[:0], *(rows[e] for e in own)])
            if dim == 3
            else number[_nodes(model, dim, own, corners[dim])]
        )
    outside = sum(_cells(model, e) for _, e in model.getEntities(3) if e not in rows)
    if outside:
        mesh.notes.append(
            f"{source}: {outside} volume cells are in no physical group and are left out. Put "
            "their volumes into one, if they belong to the part."
        )
    return mesh


def _nodes(model: Any, dim: int, entities: Sequence[int], count: int) -> Any:
    """Tags of the first nodes of all elements of some entities, shape (elements, count)."""
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
    facet = _facet(model, kind)
    for (dim, name), own in entities.items():
        of_facets = {int(k) for e in own for k in model.mesh.getElements(dim, e)[0]}
        if dim == 2 and not of_facets <= {facet}:
            raise SceneError(
                f"{source}: the facets '{name}' are of these kinds: {_shown(model, of_facets)}. "
                f"Facets of the volume cells there are of the kind {_shown(model, {facet})}."
            )
    return kind


def _facet(model: Any, kind: int) -> int:
    """gmsh's number of the facets of cells of a kind."""
    name, _, order, *_ = model.mesh.getElementProperties(kind)
    return int(model.mesh.getElementType(FACET[name.split()[0]], order))


def _shown(model: Any, kinds: set[int]) -> str:
    return ", ".join(model.mesh.getElementProperties(k)[0] for k in sorted(kinds))
