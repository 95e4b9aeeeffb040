"""The only place that names a DOLFINx version; resolved once, at import. Supported: 0.9 to 0.11."""

import sys
from copy import copy
from typing import Any

import dolfinx
import numpy as np
import numpy.typing as npt
import ufl
from mpi4py import MPI

from rigidfx.base.types import Indices, Ints

VERSION = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])
if not (0, 9) <= VERSION < (0, 12):
    raise ImportError(
        f"rigidfx supports DOLFINx 0.9 to 0.11, found {dolfinx.__version__}. "
        "Run your command by ./fenicsx, which provides a supported one."
    )


def package_version() -> str:
    """Version of this package."""
    return str(sys.modules["rigidfx"].__version__)


_facet_domains = dolfinx.fem.compute_integration_domains


def integration_facets(mesh: Any, facets: Indices) -> Indices:
    """Exterior facets as the (cell, local facet) pairs that `create_form` takes, flat.

    Interior facets among the given ones are left out, which 0.11 does not do by itself.
    """
    facets = np.intersect1d(facets, dolfinx.mesh.exterior_facet_indices(mesh.topology))
    kind = dolfinx.fem.IntegralType.exterior_facet
    if VERSION == (0, 9):
        return _facet_domains(kind, mesh.topology, facets, mesh.topology.dim - 1)
    return _facet_domains(kind, mesh.topology, facets)


def cell_geometry_dofs(mesh: Any) -> Indices:
    """Geometry nodes of each local cell, shape (cells, nodes per cell)."""
    return mesh.geometry.dofmap if VERSION == (0, 9) else mesh.geometry.dofmaps[0]


def coordinate_map(mesh: Any) -> Any:
    """The map from the reference cell to the cells of a mesh."""
    return mesh.geometry.cmap if VERSION == (0, 9) else mesh.geometry.cmaps[0]


def ghosted_partitioner() -> Any:
    """A partitioner that gives each rank the cells across its facets as ghosts."""
    return _partitioner(dolfinx.mesh.GhostMode.shared_facet)


def partitioner_without_ghosts() -> Any:
    """A partitioner that gives each rank the cells that it owns, and no others."""
    return _partitioner(dolfinx.mesh.GhostMode.none)


def _partitioner(mode: Any) -> Any:
    extra = () if VERSION == (0, 9) else (2,)  # ranks at a facet, at most
    return dolfinx.mesh.create_cell_partitioner(mode, *extra)


def create_mesh(
    comm: MPI.Intracomm, cells: Any, points: Any, element: Any, partitioner: Any = None
) -> Any:
    """A mesh of cells given on any ranks as numbers of points."""
    order = (points, element) if VERSION == (0, 9) else (element, points)
    shares = ghosted_partitioner() if partitioner is None else partitioner
    return dolfinx.mesh.create_mesh(comm, cells, *order, shares)


def adjacency(values: npt.NDArray[Any], offsets: Indices) -> Any:
    """Lists of whole numbers, one after the other, as C++ has them."""
    found = dolfinx.graph.adjacencylist(values, offsets)
    return getattr(found, "_cpp_object", found)


def partition(neighbours: Ints, offsets: Indices, parts: int) -> Ints:
    """The part of each node of a graph, of this process alone, that is cut into equal parts."""
    graph = adjacency(neighbours, offsets)
    found = dolfinx.graph.partitioner()(MPI.COMM_SELF, parts, graph, False)
    return np.asarray(found.array, dtype=np.int64)


def gmsh_order(cell: str, nodes: int) -> list[int]:
    """Which of gmsh's nodes of a cell each of DOLFINx's is."""
    kind = getattr(dolfinx.mesh.CellType, cell)
    return [int(k) for k in dolfinx.cpp.io.perm_gmsh(kind, nodes)]


def bindable(compiled: Any) -> tuple[Any, list[Any]]:
    """A compiled form that `create_form` binds right, and the coefficients that it reads.

    FFCx numbers the coefficients that are left once derivatives are applied, 0.9 binds them by
    their place in the form given: a tangent that has lost u₀ (the trapezoidal rule's) would read u₀
    in place of u₁. So 0.9 is given a form of those that are left, and of the constants.
    """
    form, ufcx = compiled.ufl_form, compiled.ufcx_form
    given, places = form.coefficients(), ufcx.original_coefficient_positions
    left = [given[places[k]] for k in range(ufcx.num_coefficients)]
    named = [ufl.inner(w, w) for w in (*left, *form.constants())]
    if VERSION == (0, 9) and named:
        dx = ufl.dx(domain=form.ufl_domains()[0])
        compiled = copy(compiled)  # with all that it holds beside its fields, as kernels of ours
        compiled.ufl_form = sum(named[1:], named[0]) * dx
    return compiled, left


def known_columns(pattern: Any) -> Any:
    """Index map of the columns of a finished sparsity pattern, ghosts of other ranks included."""
    return pattern.column_index_map() if VERSION < (0, 11) else pattern.index_map(1)


def assemble_unrolled(A: Any, form: Any) -> None:
    """Add a bilinear form into a matrix whose local-to-global map numbers dofs one by one."""
    cpp = form._cpp_object
    constants = dolfinx.cpp.fem.pack_constants(cpp)
    coefficients = dolfinx.cpp.fem.pack_coefficients(cpp)
    dolfinx.cpp.fem.petsc.assemble_matrix(A, cpp, constants, coefficients, [], True)
