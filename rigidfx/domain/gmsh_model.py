"""Read gmsh's files: physical groups become the names of a domain.

In mesh files of version 2 gmsh takes a group for all entities in which one of its cells lies.
Converters such as meshio give all cells the same entity: each group is made an entity of its own.
UNV files are looked at before gmsh reads them, as its reader ends Python where a group names an
element that the file has not; gmsh itself writes groups of points so.
"""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import SceneError
from rigidfx.base.files import decoded
from rigidfx.base.inputs import positive
from rigidfx.domain.arrays import FileMesh, read_domain
from rigidfx.domain.domain import Domain
from rigidfx.domain.gmsh_groups import Header, mesh_of_model, names_in_header


@contextmanager
def silent() -> Iterator[None]:
    """Drop all that is written to the process's standard output."""
    try:
        sys.stdout.flush()
        kept = os.dup(1)
    except (OSError, ValueError, AttributeError):  # there is none
        yield
        return
    try:
        with open(os.devnull, "wb") as nothing:
            os.dup2(nothing.fileno(), 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


@contextmanager
def silent_files(gmsh: Any) -> Iterator[None]:
    """Let a function of a user read and write files in silence; what it prints itself stays."""
    calls = (gmsh, "open"), (gmsh, "merge"), (gmsh, "write"), (gmsh.model.occ, "importShapes")
    own = [getattr(owner, name) for owner, name in calls]
    try:
        for (owner, name), call in zip(calls, own, strict=True):
            setattr(owner, name, _silenced(call))
        yield
    finally:
        for (owner, name), call in zip(calls, own, strict=True):
            setattr(owner, name, call)


def _silenced(call: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(call)
    def quiet(*given: Any, **named: Any) -> Any:
        with silent():
            return call(*given, **named)

    return quiet


# Suffixes of geometry without a mesh, and the function that reads it.
GEOMETRY = {".geo": "read_geo", ".geo_unrolled": "read_geo"} | dict.fromkeys(
    (".step", ".stp", ".brep", ".iges", ".igs"), "read_cad"
)

# Suffixes of meshes of other programs that gmsh merges; some builds have no MED and CGNS.
MERGED = (".unv", ".med", ".cgns", ".bdf", ".nas", ".vtk", ".mesh")

# Options that reading changes.
OPTIONS = (
    "Geometry.OCCBoundsUseStl",
    "General.Terminal",
    "Mesh.MeshSizeMax",
    "Mesh.MeshSizeFromCurvature",
    "Mesh.SwitchElementTags",
)
ELEMENTS = "2412"  # the number of their data set
GROUPS = ("2429", "2430", "2432", "2435", "2452", "2467", "2477")  # those of groups
BEAMS = ("11", "21", "22", "23", "24")  # kinds of elements that take a line more
OF_ELEMENTS = "8"  # the kind of a group's member that is an element


def check_unv(path: Path) -> None:
    """Refuse groups of elements that are not there, by the group's name and the element."""
    known: set[str] = set()
    members: list[tuple[str, str]] = []
    for kind, lines in _data_sets(path):
        try:
            if kind == ELEMENTS:
                known.update(_elements(lines))
            elif kind in GROUPS:
                members += _members(lines)
        except (IndexError, ValueError, RuntimeError, StopIteration):
            raise SceneError(f"'{path}' is damaged: data set {kind} breaks off.") from None
    for name, number in members:
        if number not in known:
            raise SceneError(
                f"'{path}': the group '{name}' names element {number}, which is not in the file. "
                "Write it without this group, of points, say; with_vertices names points."
            )


def _data_sets(path: Path) -> Iterator[tuple[str, Iterator[list[str]]]]:
    """Number of each data set, and the words of its lines."""
    own: list[list[str]] | None = None
    with path.open("rb") as file:
        for line in file:
            words = decoded(line).split()
            if words != ["-1"]:
                if own is not None and (not own or own[0][0] in (ELEMENTS, *GROUPS)):
                    own.append(words or [""])
            elif own is None:
                own = []
            else:
                if own and own[0]:
                    yield own[0][0], iter(own[1:])
                own = None
    if own is not None:
        raise SceneError(f"'{path}' is damaged: its last data set breaks off.")


def _elements(lines: Iterator[list[str]]) -> Iterator[str]:
    for words in lines:
        yield words[0]
        left = int(words[5])
        if words[1] in BEAMS:
            next(lines)
        while left > 0:
            left -= len(next(lines))


def _members(lines: Iterator[list[str]]) -> list[tuple[str, str]]:
    """Pairs of a group's name and an element of it."""
    found = []
    for words in lines:
        left, name = int(words[-1]), " ".join(next(lines))
        while left > 0:
            entries = next(lines)
            for kind, number in zip(entries[0::4], entries[1::4], strict=False):
                left -= 1
                if kind == OF_ELEMENTS:
                    found.append((name, number))
    return found


def separate_groups(gmsh: Any, path: str | Path, header: Header) -> None:
    """Open a file anew with its groups as entities, if entities do not tell its groups apart.

    It is refused if that would lose cells that are in several groups.
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


def read_msh(
    path: str | Path, comm: MPI.Intracomm = MPI.COMM_WORLD, *, scale: float = 1.0
) -> Domain:
    """Read a gmsh file; its physical groups become the names of the domain. Collective.

    Groups of cells and facets become sets of these, groups of curves sets of edges, groups of
    points sets of vertices. A group without a name goes by its kind and number, such as
    "facets-4". A name without elements is kept, as an empty set. Of a file without any group, as
    converters leave it, all volume cells are named "body".

    Args:
        path: A .msh file of gmsh, of version 4.1 or 2.2, or what else gmsh reads: UNV, MED and CGNS
            with the names of their groups, BDF (Nastran), VTK and MESH, whose volumes are named
            "part 1", "part 2", …, by gmsh's numbers, if there are several. It is read on rank 0
            only. INP is for `read_inp`.
        comm: Communicator of the mesh.
        scale: Metres per unit of length of the file.

    Raises:
        SceneError: If the file is missing or unreadable, holds groups but none of volume cells,
            cells of several or unknown kinds, facets that bound none of them, or a name twice.
    """
    factor = positive("read_msh", "scale", scale)

    def fill(gmsh: Any, notes: list[str]) -> Header:
        reader = GEOMETRY.get(Path(path).suffix.lower())
        if reader:
            raise SceneError(f"'{path}' is a geometry, not a mesh. Take {reader}, which meshes it.")
        find_file(path, "mesh")
        suffix = Path(path).suffix.lower()
        if suffix in MERGED:
            _merge(gmsh, path)
            return {}
        if suffix == ".inp":
            raise SceneError(f"'{path}' is an input file of Abaqus or CalculiX: take read_inp.")
        with Path(path).open("rb") as file:
            if not file.readline().lstrip().startswith(b"$"):
                # gmsh would take it for a script, and its parser not forget where it stopped.
                raise SceneError(
                    f"'{path}' is no mesh file of gmsh: no $MeshFormat. Files of other kinds are "
                    f"known by their names' ends: {', '.join(MERGED)}; convert others, by "
                    "'meshio convert FILE part.msh --output-format gmsh22'."
                )
        gmsh.open(str(path))
        header = names_in_header(path)
        separate_groups(gmsh, path, header)
        return header

    return domain_of(comm, f"gmsh: reading '{path}'", f"'{path}'", fill, factor)


def _merge(gmsh: Any, path: str | Path) -> None:
    """Read a mesh of another program; name its volumes, if it has no groups but several of them."""
    gmsh.model.add("rigidfx")
    if Path(path).suffix.lower() == ".unv":
        check_unv(Path(path))
    gmsh.merge(str(path))
    volumes = gmsh.model.getEntities(3)
    if len(volumes) > 1 and not gmsh.model.getPhysicalGroups():
        for _, number in volumes:
            gmsh.model.addPhysicalGroup(3, [number], name=f"part {number}")


def from_gmsh(
    build: Callable[[Any], None], comm: MPI.Intracomm = MPI.COMM_WORLD, *, scale: float = 1.0
) -> Domain:
    """A domain of a model that is built with gmsh's Python interface. Collective.

    Its physical groups become the names of the domain, as `read_msh` says.

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
        scale: Metres per unit of length of the model.

    Raises:
        SceneError: If the function fails, or the model holds groups but none of volume cells,
            cells of several or unknown kinds, facets that bound none of them, or a name twice.
    """
    factor = positive("from_gmsh", "scale", scale)

    def fresh(gmsh: Any, notes: list[str]) -> None:
        gmsh.model.add("rigidfx")
        with silent_files(gmsh):
            build(gmsh)

    return domain_of(
        comm, "from_gmsh: the function that builds the model", "The model", fresh, factor
    )


@contextmanager
def gmsh_session() -> Iterator[Any]:
    """The module gmsh, ready and silent, or a `SceneError`; an open session stays as it was."""
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
        if not gmsh.isInitialized():  # a user's function has ended it
            pass
        elif ours:
            gmsh.finalize()
        else:
            for name, value in options.items():
                gmsh.option.setNumber(name, value)
            for name in set(gmsh.model.list()) - set(before):
                gmsh.model.setCurrent(name)
                gmsh.model.remove()
            gmsh.model.setCurrent(current)


def find_file(path: str | Path, kind: str) -> None:
    """Refuse a path that is no file."""
    if not Path(path).is_file():
        raise SceneError(f"There is no {kind} file '{path}' (looked in {Path.cwd()}).")


def domain_of(
    comm: MPI.Intracomm,
    owner: str,
    source: str,
    fill: Callable[[Any, list[str]], Header | None],
    scale: float,
) -> Domain:
    """The domain of gmsh's model once a function has filled and meshed it. Collective.

    Rank 0 alone calls `fill` with the module and texts of warnings, to which it may add; it may
    return names of groups that gmsh does not tell. A failure raises `SceneError`.
    """

    def read() -> FileMesh:
        notes: list[str] = []
        with gmsh_session() as gmsh:
            header = fill(gmsh, notes) or {}
            if not gmsh.isInitialized():
                raise SceneError(
                    f"{owner} has ended gmsh (finalize); that is for its caller to do."
                )
            mesh = mesh_of_model(gmsh, source, header, scale)
        mesh.notes += notes
        return mesh

    return read_domain(comm, owner, source, read)
