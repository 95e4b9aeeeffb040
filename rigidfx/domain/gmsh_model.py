"""Read gmsh's files: physical groups become the names of a domain.

gmsh lets a face or a volume be in several groups, DOLFINx's tags hold one number per cell or facet.
So the groups are replaced, before the mesh is handed over, by one for each elementary entity, and a
name then stands for the entities of its group.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.spatial import cKDTree

from rigidfx.base import compat
from rigidfx.base.errors import SceneError, together
from rigidfx.base.inputs import positive
from rigidfx.domain.domain import KINDS, Domain, EntitySet

__all__ = ["domain_of", "find_file", "from_gmsh", "gmsh_session", "read_msh"]

# gmsh's numbers of the cells that DOLFINx and rigidfx know, and of their facets.
KNOWN = {4: "tetrahedra", 5: "hexahedra", 11: "second-order tetrahedra", 12: "27-node hexahedra"}
FACETS = {4: 2, 5: 3, 11: 9, 12: 10}
CORNERS = {4: 3, 5: 4, 11: 3, 12: 4}  # of a facet
# What is not a mesh yet, and the function that reads it.
GEOMETRY = {".geo": "read_geo", ".geo_unrolled": "read_geo"} | dict.fromkeys(
    (".step", ".stp", ".brep", ".iges", ".igs"), "read_cad"
)

# Options that reading changes.
OPTIONS = (
    "General.Terminal",
    "Mesh.MeshSizeMax",
    "Mesh.MeshSizeFromCurvature",
)

SAME_PLACE = 1e-6  # of the smallest cell's diameter: points no farther apart are one
UNLISTED = 1000  # numbers, from 1 and from the last group's on, at which empty ones are looked for

Names = dict[tuple[int, str], Any]
Header = Mapping[tuple[int, int], str]  # names by dimension and number


def read_msh(
    path: str | Path, comm: MPI.Intracomm = MPI.COMM_WORLD, *, scale: float = 1.0
) -> Domain:
    """Read a gmsh file; its physical groups become the names of the domain. Collective.

    Groups of cells and facets become sets of these, groups of points sets of vertices, groups of
    curves sets of the vertices on them. A group without a name goes by its kind and number, such as
    "facets-4". A name without elements is kept, as an empty set.

    Args:
        path: A .msh file, or another mesh that gmsh reads; it is read on rank 0 only.
        comm: Communicator of the mesh.
        scale: Metres per unit of length of the file.

    Raises:
        SceneError: If the file is missing or unreadable, holds no named group of volume cells,
            cells of several or unknown kinds, facets that bound none of them, or a name twice.
    """
    factor = positive("read_msh", "scale", scale)

    def fill(gmsh: Any) -> Header:
        reader = GEOMETRY.get(Path(path).suffix.lower())
        if reader:
            raise SceneError(f"'{path}' is a geometry, not a mesh. Take {reader}, which meshes it.")
        find_file(path, "mesh")
        with Path(path).open("rb") as file:
            if not file.readline().lstrip().startswith(b"$"):
                # gmsh would take it for a script, and its parser not forget where it stopped.
                raise SceneError(f"'{path}' is no mesh file of gmsh: no $MeshFormat.")
        gmsh.open(str(path))
        return _header(path)

    return domain_of(comm, f"gmsh: reading '{path}'", f"'{path}'", fill, factor)


def from_gmsh(build: Callable[[Any], None], comm: MPI.Intracomm = MPI.COMM_WORLD) -> Domain:
    """A domain of a model that is built with gmsh's Python interface. Collective.

    Example:
        >>> def ball(gmsh):                                   # doctest: +SKIP
        ...     volume = gmsh.model.occ.addSphere(0, 0, 0, 1.0)
        ...     gmsh.model.occ.synchronize()
        ...     gmsh.model.addPhysicalGroup(3, [volume], name="ball")
        ...     gmsh.model.mesh.generate(3)
        >>> domain = from_gmsh(ball)

    Args:
        build: Function of the module gmsh that adds geometry and physical groups to its model and
            meshes it; called on rank 0 only.
        comm: Communicator of the mesh.

    Raises:
        SceneError: If the function fails, or the model holds no named group of volume cells,
            cells of several or unknown kinds, facets that bound none of them, or a name twice.
    """

    def fresh(gmsh: Any) -> None:
        gmsh.model.add("rigidfx")
        build(gmsh)

    return domain_of(comm, "from_gmsh: the function that builds the model", "The model", fresh)


@contextmanager
def gmsh_session() -> Iterator[Any]:
    """The module gmsh, ready and silent; a session that was open before is left as it was.

    Raises:
        SceneError: If there is no such module.
    """
    try:
        import gmsh
    except ImportError:
        raise SceneError("Meshes of gmsh need its Python module (pip install gmsh).") from None
    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize(interruptible=False)
    before = gmsh.model.list()
    current = gmsh.model.getCurrent()
    options = {name: gmsh.option.getNumber(name) for name in OPTIONS}
    gmsh.option.setNumber("General.Terminal", 0)
    try:
        yield gmsh
    finally:
        if ours:
            gmsh.finalize()
        else:
            for name, value in options.items():
                gmsh.option.setNumber(name, value)
            for name in set(gmsh.model.list()) - set(before):
                gmsh.model.setCurrent(name)
                gmsh.model.remove()
            gmsh.model.setCurrent(current)


def find_file(path: str | Path, kind: str) -> None:
    """Refuse a path that is no file.

    Raises:
        SceneError: If it is none.
    """
    if not Path(path).is_file():
        raise SceneError(f"There is no {kind} file '{path}' (looked in {Path.cwd()}).")


def domain_of(
    comm: MPI.Intracomm,
    owner: str,
    source: str,
    fill: Callable[[Any], Header | None],
    scale: float = 1.0,
) -> Domain:
    """The domain of gmsh's model once a function has filled and meshed it. Collective.

    Args:
        comm: Communicator of the mesh.
        owner: What fails if the function does.
        source: Where the model comes from, for messages.
        fill: Function of the module gmsh; called on rank 0 only. It may return names of groups by
            dimension and number, for those that gmsh does not tell.
        scale: Metres per unit of length of the model.

    Raises:
        SceneError: If the function fails or its model cannot be a domain.
    """
    with ExitStack() as session:

        def read() -> tuple[Any, Names]:
            if comm.rank > 0:
                return None, {}
            gmsh = session.enter_context(gmsh_session())
            header = fill(gmsh) or {}
            if scale != 1.0:
                gmsh.model.mesh.affineTransform(np.diag([scale, scale, scale, 1.0]).ravel())
            return gmsh.model, _names(gmsh.model, source, header)

        model, local = together(comm, owner, read)
        names: Names = comm.bcast(local)
        mesh, cells, facets = compat.model_to_mesh(model, comm)
    mesh.topology.create_connectivity(2, 3)
    tags = {3: cells, 2: facets}
    sets = []
    for (dim, name), value in names.items():
        if dim >= 2:
            members = [tags[dim].find(tag) for tag in value]
            entities = np.unique(np.concatenate([np.empty(0, np.int32), *members]))
            sets.append(EntitySet(name, dim, entities.astype(np.int32)))
        elif not len(value):
            sets.append(EntitySet(name, 0, np.empty(0, np.int32)))
    domain = Domain(mesh, sets)
    owned = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    least = comm.allreduce(float(mesh.h(3, owned).min(initial=np.inf)), op=MPI.MIN)
    for (dim, name), value in names.items():
        if dim < 2 and len(value):
            domain = domain.with_vertices(name, _among(value, SAME_PLACE * least))
    return domain


def _among(points: npt.NDArray[np.float64], tolerance: float) -> Any:
    """A marker of the given points, up to a distance [m]."""
    tree = cKDTree(points)
    return lambda x: tree.query(x.T)[0] <= tolerance


def _header(path: str | Path) -> dict[tuple[int, int], str]:
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
                found[int(match[1]), int(match[2])] = match[3].decode(errors="replace")
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
        name = model.getPhysicalName(dim, tag) or header.get((dim, tag), "")
        if name or (dim, tag) in filled:
            groups.append((dim, name or f"{KINDS[dim]}-{tag}", tag))
    return groups


def _names(model: Any, source: str, header: Header) -> Names:
    """Give gmsh's model one group per entity; what its names stand for.

    Returns:
        By dimension and name: numbers of entities, or positions of points for dimensions 0, 1.
    """
    groups = _groups(model, header)
    listed = ", ".join(f"'{name}' ({KINDS[dim]})" for dim, name, _ in groups) or "none"
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
    filled = set(model.getPhysicalGroups())
    entities = {
        (dim, name): model.getEntitiesForPhysicalGroup(dim, tag).tolist()
        if (dim, tag) in filled
        else []
        for dim, name, tag in groups
    }
    volumes = {e for (dim, _), own in entities.items() if dim == 3 for e in own}
    # Files of version 2 hold a cell once for each of its groups.
    model.mesh.removeDuplicateElements()
    kinds = {int(k) for e in volumes for k in model.mesh.getElements(3, e)[0]}
    if not kinds:
        raise SceneError(
            f"{source} has no physical group of volume cells (dimension 3) with cells in it, "
            f"which are what a domain is made of. Physical groups there: {listed}. Was the mesh "
            "generated in 3D before it was saved?"
        )
    if len(kinds) > 1 or not kinds <= set(KNOWN):
        raise SceneError(
            f"{source} has volume cells of these kinds: {_shown(model, kinds)}. A domain takes one "
            f"kind, out of {', '.join(KNOWN.values())}."
        )
    facet = FACETS[next(iter(kinds))]
    for (dim, name), own in entities.items():
        of_facets = {int(k) for e in own for k in model.mesh.getElements(dim, e)[0]}
        if dim == 2 and not of_facets <= {facet}:
            raise SceneError(
                f"{source}: the facets '{name}' are of these kinds: {_shown(model, of_facets)}. "
                f"Facets of the volume cells there are of the kind {_shown(model, {facet})}."
            )
    _check_facets(model, source, kinds.pop(), entities)
    positions = {
        (dim, name): np.concatenate(
            [[], *(model.mesh.getNodes(dim, e, includeBoundary=True)[1] for e in own)]
        ).reshape(-1, 3)
        for (dim, name), own in entities.items()
        if dim < 2
    }
    model.removePhysicalGroups()
    used = {(dim, e) for (dim, _), own in entities.items() if dim >= 2 for e in own}
    for dim, tag in sorted(used):
        if len(model.mesh.getElements(dim, tag)[0]):
            model.addPhysicalGroup(dim, [tag], tag=tag)
    model.mesh.renumberNodes()  # DOLFINx takes numbers without gaps only
    return {**entities, **positions}


def _check_facets(
    model: Any, source: str, kind: int, entities: Mapping[tuple[int, str], list[int]]
) -> None:
    """Refuse facets that bound no cell of the mesh; DOLFINx would end all ranks over them.

    Raises:
        SceneError: With the names that have such facets.
    """
    corners = CORNERS[kind]
    facets = {}
    for e in {e for (dim, _), own in entities.items() if dim == 2 for e in own}:
        of_type = model.mesh.getElements(2, e)
        rows = [n.reshape(len(t), -1)[:, :corners] for _, t, n in zip(*of_type, strict=True)]
        facets[e] = np.concatenate([np.empty((0, corners), np.uint64), *rows])
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
