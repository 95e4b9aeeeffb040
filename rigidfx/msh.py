"""Read gmsh's files: physical groups become the names of a domain.

gmsh lets a face or a volume be in several groups, DOLFINx's tags hold one number per cell or facet.
So the groups are replaced, before the mesh is handed over, by one for each elementary entity, and a
name then stands for the entities of its group.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.spatial import cKDTree

from rigidfx import _compat
from rigidfx.domain import KINDS, Domain, EntitySet
from rigidfx.errors import SceneError, together

__all__ = ["from_gmsh", "read_msh"]

# gmsh's numbers of the cells that DOLFINx and rigidfx know.
KNOWN = {4: "tetrahedra", 5: "hexahedra", 11: "second-order tetrahedra", 12: "27-node hexahedra"}

Names = dict[tuple[int, str], Any]


def read_msh(path: str | Path, comm: MPI.Intracomm = MPI.COMM_WORLD) -> Domain:
    """Read a gmsh file; its physical groups become the names of the domain. Collective.

    Groups of cells and facets become sets of these, groups of points sets of vertices, groups of
    curves sets of the vertices on them.

    Args:
        path: A .msh file; it is read on rank 0 only.
        comm: Communicator of the mesh.

    Raises:
        SceneError: If the file is missing or unreadable, holds no named group of volume cells, or
            cells of several or unknown kinds.
    """
    return _domain(comm, f"gmsh: reading '{path}'", f"'{path}'", lambda gmsh: _open(gmsh, path))


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
        SceneError: If the function fails, or the model holds no named group of volume cells, or
            cells of several or unknown kinds.
    """

    def fresh(gmsh: Any) -> None:
        gmsh.model.add("rigidfx")
        build(gmsh)

    return _domain(comm, "from_gmsh: the function that builds the model", "The model", fresh)


def _domain(comm: MPI.Intracomm, owner: str, source: str, fill: Callable[[Any], None]) -> Domain:
    """The domain of gmsh's model once a function has filled it. Collective.

    Args:
        comm: Communicator of the mesh.
        owner: What fails if the function does.
        source: Where the model comes from, for messages.
        fill: Function of the module gmsh.
    """
    gmsh: Any = None
    first = comm.rank == 0
    try:
        if first:
            try:
                import gmsh as module
            except ImportError:
                module = None
            gmsh = module

        def read() -> Names:
            if not first:
                return {}
            _start(gmsh)
            fill(gmsh)
            return _names(gmsh, source)

        names: Names = comm.bcast(together(comm, owner, read))
        mesh, cells, facets = _compat.model_to_mesh(gmsh.model if first else None, comm)
    finally:
        if gmsh is not None and gmsh.isInitialized():
            gmsh.finalize()
    mesh.topology.create_connectivity(2, 3)
    tags = {3: cells, 2: facets}
    sets = []
    for (dim, name), value in names.items():
        if dim >= 2:
            members = [tags[dim].find(tag) for tag in value]
            entities = np.unique(np.concatenate([np.empty(0, np.int32), *members]))
            sets.append(EntitySet(name, dim, entities.astype(np.int32)))
    domain = Domain(mesh, sets)
    for (dim, name), value in names.items():
        if dim < 2:
            domain = domain.with_vertices(name, _among(value))
    return domain


def _among(points: npt.NDArray[np.float64]) -> Any:
    """A marker of the given points."""
    tree = cKDTree(points)
    size = float(np.abs(points).max(initial=0.0))
    return lambda x: tree.query(x.T)[0] <= 1e-12 + 1e-9 * size


def _start(gmsh: Any) -> None:
    if gmsh is None:
        raise SceneError("Meshes of gmsh need its Python module (pip install gmsh).")
    if not gmsh.isInitialized():
        gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)


def _open(gmsh: Any, path: str | Path) -> None:
    """Open a file as gmsh's model."""
    if not Path(path).is_file():
        raise SceneError(f"There is no mesh file '{path}' (looked in {Path.cwd()}).")
    gmsh.open(str(path))


def _names(gmsh: Any, source: str) -> Names:
    """Give gmsh's model one group per entity; what its names stand for.

    Returns:
        By dimension and name: numbers of entities, or positions of points for dimensions 0, 1.
    """
    model = gmsh.model
    groups = [
        (dim, model.getPhysicalName(dim, tag) or f"{KINDS[dim]}-{tag}", tag)
        for dim, tag in model.getPhysicalGroups()
    ]
    listed = ", ".join(f"'{name}' ({KINDS[dim]})" for dim, name, _ in groups) or "none"
    entities: dict[tuple[int, str], list[int]] = {(dim, name): [] for dim, name, _ in groups}
    for dim, name, tag in groups:
        entities[dim, name] += list(model.getEntitiesForPhysicalGroup(dim, tag))
    volumes = {e for (dim, _), own in entities.items() if dim == 3 for e in own}
    kinds = {int(k) for e in volumes for k in model.mesh.getElements(3, e)[0]}
    if not kinds:
        raise SceneError(
            f"{source} has no physical group of volume cells (dimension 3) with cells in it, "
            f"which are what a domain is made of. Physical groups there: {listed}. Was the mesh "
            "generated in 3D before it was saved?"
        )
    if len(kinds) > 1 or not kinds <= set(KNOWN):
        shown = ", ".join(model.mesh.getElementProperties(k)[0] for k in sorted(kinds))
        raise SceneError(
            f"{source} has volume cells of these kinds: {shown}. A domain takes one kind, out of "
            f"{', '.join(KNOWN.values())}."
        )
    positions = {
        (dim, name): np.concatenate(
            [model.mesh.getNodes(dim, e, includeBoundary=True)[1] for e in own]
        ).reshape(-1, 3)
        for (dim, name), own in entities.items()
        if dim < 2
    }
    model.removePhysicalGroups()
    used = {(dim, e) for (dim, _), own in entities.items() if dim >= 2 for e in own}
    for dim, number in sorted(used):
        if len(model.mesh.getElements(dim, number)[0]):
            model.addPhysicalGroup(dim, [number], tag=number)
    return {**entities, **positions}
