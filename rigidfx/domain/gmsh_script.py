"""Read gmsh's scripts: geometry with physical names, meshed when it is read.

Second-order cells that gmsh has turned inside out are mended, as its own optimisers throw C++
exceptions that nobody can catch. Let s be the place of a node in the straight cell, and d = x - s.
First, nodes on edges inside follow those on surfaces: ∇·∇d = 0 around such cells. If cells are left
with det J below LEAST of the straight cell's, their nodes go towards s, x ← s + t d, with t halved
until none is.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import basix
import numpy as np
from mpi4py import MPI
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from rigidfx.base.errors import SceneError
from rigidfx.base.files import decoded
from rigidfx.base.inputs import number, positive, shown
from rigidfx.base.types import Array, Bools, Ints
from rigidfx.domain.cell_quality import check_points
from rigidfx.domain.domain import Domain
from rigidfx.domain.gmsh_model import domain_of, find_file, silent

LAST: dict[Path, tuple[float, bytes]] = {}  # of each file, the last size and a mesh's digest
LEAST = 0.1  # of the straight cell's det J: gmsh's Mesh.HighOrderThresholdMin; also the least t
CURVED = np.sqrt(np.finfo(float).eps)  # of a cell's size: nodes farther off are of curved edges

# Kinds of cells by gmsh's names.
KINDS = {"Tetrahedron": basix.CellType.tetrahedron, "Hexahedron": basix.CellType.hexahedron}


def straighten(gmsh: Any, metres: float) -> str:
    """Mend curved cells of gmsh's model, in `metres` per unit, where det J would vanish.

    Returns a text that says how many are straighter than the geometry, where, and by how much.
    """
    mesh = gmsh.model.mesh
    tags, flat, _ = mesh.getNodes()
    x = np.reshape(flat, (-1, 3))
    row = np.zeros(int(tags.max(initial=0)) + 1, np.int64)
    row[tags] = np.arange(len(tags))
    on_surface = np.zeros(len(x), dtype=bool)
    on_surface[row[mesh.getNodes(2, -1, includeBoundary=True)[0]]] = True
    told = ""
    for name, cell in KINDS.items():
        kind = mesh.getElementType(name, 2)
        cells = row[mesh.getElementsByType(kind)[1]].reshape(-1, mesh.getElementProperties(kind)[3])
        if not len(cells):
            continue
        moved, bad = _Cells.of(mesh, name, cell, x, cells).mended(x, on_surface)
        for node in np.flatnonzero((moved != x).any(axis=1)):
            mesh.setNode(tags[node], moved[node], [])
        off = float(np.linalg.norm(moved - x, axis=1)[on_surface].max(initial=0.0))
        if off:
            place = ", ".join(f"{value:.4g}" for value in metres * x[cells[bad[0]]].mean(axis=0))
            told = (
                f"{len(bad)} of {len(cells)} cells would be inside out, or nearly, if they were as "
                f"curved as the geometry. They are straighter, by up to {metres * off:.2g} m,"
                f" the first around ({place}) m. Smaller cells (size; in read_cad also "
                "per_circle=24, along curves only) bring them nearer to the geometry."
            )
    return told


@dataclass(frozen=True)
class _Cells:
    """Cells of second order of one kind."""

    nodes: Ints  # rows of nodes, shape (cells, nodes of each)
    straight: Array  # place of each node in the straight cells, shape (nodes, 3)
    corners: Bools  # whether a node is a corner of a cell, shape (nodes,)
    # Derivatives of their functions at points where det J is checked, shape (points, nodes of each,
    # 3); the last points are those of a rule ...
    slopes: Array
    weights: Array  # ... with these weights

    @classmethod
    def of(cls, mesh: Any, name: str, cell: basix.CellType, x: Array, nodes: Ints) -> _Cells:
        """Cells of gmsh's mesh, by its name of their kind and by basix's."""
        first, kind = (mesh.getElementType(name, order) for order in (1, 2))
        degree = 3 if cell == basix.CellType.tetrahedron else 5  # of det J
        lattice = basix.create_lattice(cell, degree, basix.LatticeType.equispaced, True)
        rule, weights = basix.make_quadrature(cell, 4)
        points = np.vstack([lattice, check_points(cell, 2), rule])
        if cell == basix.CellType.hexahedron:
            points = 2 * points - 1  # gmsh's hexahedra reach from -1 to 1
        slopes = _values(mesh, kind, points, "GradLagrange").reshape(len(points), -1, 3)
        at_nodes = np.reshape(mesh.getElementProperties(kind)[4], (-1, 3))
        functions = _values(mesh, first, at_nodes, "Lagrange")
        straight = x.copy()
        at_corners = nodes[:, : functions.shape[1]]
        straight[nodes] = np.einsum("nk,cki->cni", functions, x[at_corners])
        corners = np.zeros(len(x), dtype=bool)
        corners[at_corners] = True
        return cls(nodes, straight, corners, slopes, weights)

    def mended(self, x: Array, fixed: Bools) -> tuple[Array, Ints]:
        """Places of nodes once all cells are sound, and cells that had to be straightened.

        Nodes on a surface, `fixed`, stay in place.
        """
        bad = self._bad(x)
        if not len(bad):
            return x, bad
        relaxed = self._relaxed(x, fixed, bad)
        if len(self._bad(relaxed)) < len(bad):
            x = relaxed
        part = np.ones(len(x))  # t of each node
        found = bad[:0]
        while True:
            now = np.where(
                part[:, None] < 1, self.straight + part[:, None] * (x - self.straight), x
            )
            bad = self._bad(now)
            bad = bad[part[self.nodes[bad]].max(axis=1) > 0]  # others are straight
            if not len(bad):
                return now, found
            found = np.union1d(found, bad)
            touched = np.unique(self.nodes[bad])
            part[touched] = np.where(part[touched] > 2 * LEAST, part[touched] / 2, 0.0)

    def _bad(self, x: Array) -> Ints:
        """Cells whose det J is too small, or of the wrong sign, at nodes' places x."""
        size = np.linalg.norm(np.ptp(self.straight[self.nodes], axis=1), axis=1)
        bend = np.linalg.norm(x - self.straight, axis=1)[self.nodes].max(axis=1)
        curved = np.flatnonzero(bend > CURVED * size)
        usual = np.linalg.det(self._jacobians(self.straight, curved)).mean(axis=1)
        now = np.linalg.det(self._jacobians(x, curved))
        return curved[(now / usual[:, None]).min(axis=1) < LEAST]

    def _jacobians(self, x: Array, cells: Ints) -> Array:
        """J, shape (cells, points, 3, 3)."""
        return np.einsum("pnj,cni->cpij", self.slopes, x[self.nodes[cells]], optimize=True)

    def _relaxed(self, x: Array, fixed: Bools, bad: Ints) -> Array:
        """Places once nodes on edges inside follow those on surfaces, around some cells."""
        near = np.zeros(len(x), dtype=bool)
        near[self.nodes[bad]] = True
        near[self.nodes[near[self.nodes].any(axis=1)]] = True
        free = near & ~fixed & ~self.corners
        if not free.any():
            return x
        cells = np.flatnonzero(free[self.nodes].any(axis=1))
        J = self._jacobians(self.straight, cells)[:, -len(self.weights) :]
        slopes = self.slopes[-len(self.weights) :]
        slopes = np.einsum("pnj,cpji->cpni", slopes, np.linalg.inv(J), optimize=True)
        volumes = self.weights * np.abs(np.linalg.det(J))
        K = np.einsum("cp,cpni,cpmi->cnm", volumes, slopes, slopes, optimize=True)
        nodes = self.nodes[cells]
        rows, columns = np.broadcast_arrays(nodes[:, :, None], nodes[:, None, :])
        shape = (len(x), len(x))
        whole = coo_array((K.ravel(), (rows.ravel(), columns.ravel())), shape).tocsr()[free]
        d = x - self.straight
        d[free] = 0.0
        d[free] = spsolve(whole[:, free].tocsc(), -(whole @ d)).reshape(-1, 3)
        return self.straight + d


def _values(mesh: Any, kind: int, points: Array, called: str) -> Array:
    """Functions of a kind of cells at points of the reference cell, shape (points, …)."""
    values = mesh.getBasisFunctions(kind, points.ravel(), called)[1]
    return np.reshape(values, (len(points), -1))


def read_geo(
    path: str | Path,
    parameters: Mapping[str, float | str] | None = None,
    *,
    size: float | None = None,
    order: int | None = None,
    scale: float = 1.0,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> Domain:
    """Run a .geo script of gmsh and mesh its geometry. Collective.

    Its physical groups become the names of the domain, as `read_msh` says. A mesh that the script
    generates itself is taken as it is, unless a size or an order is asked for.

    Example:
        >>> domain = read_geo("meshes/bracket.geo", {"thickness": 0.004})   # doctest: +SKIP

    Args:
        path: The script; it is run on rank 0 only.
        parameters: Values of constants that the script defines by DefineConstant.
        size: Largest edge of a cell [m]; where the script asks for less, that holds. The script's
            own if None.
        order: Order of the cells' geometry, 1 or 2; the script's own if None.
        scale: Metres per unit of length of the script.
        comm: Communicator of the mesh.

    Raises:
        SceneError: If the script is missing or fails, knows no such parameter, cannot be meshed, or
            its mesh cannot be a domain (see `read_msh`).
    """
    factor = positive("read_geo", "scale", scale)
    largest = None if size is None else positive("read_geo", "size", size) / factor
    check_order("read_geo", order)
    if not (parameters is None or isinstance(parameters, Mapping)):
        raise SceneError(
            f"read_geo: parameters must be a dict of names to numbers or texts, "
            f"got {shown(parameters)}."
        )
    given = dict(parameters or {})
    for name, value in given.items():
        if not isinstance(value, str):
            given[name] = number("read_geo", f"the parameter '{name}'", value)

    def fill(gmsh: Any, notes: list[str]) -> None:
        find_file(path, "geometry")
        _check_parameters(Path(path), given)
        gmsh.model.add("rigidfx")
        _run(gmsh, path, given)
        told = mesh_model(gmsh, path, largest, order, factor)
        notes += [f"read_geo: '{path}': {text}" for text in told]

    return domain_of(comm, f"gmsh: '{path}'", f"'{path}'", fill, factor)


def _run(gmsh: Any, path: str | Path, given: Mapping[str, float | str]) -> None:
    """Run a script to its end. Left in the middle, gmsh's parser would spoil the next one."""
    gmsh.parser.clear()  # values of another script
    gmsh.onelab.clear()
    for name, value in given.items():
        if isinstance(value, str):
            gmsh.parser.setString(name, [value])
        else:
            gmsh.parser.setNumber(name, [value])
    stop = gmsh.option.getNumber("General.AbortOnError")
    gmsh.option.setNumber("General.AbortOnError", 0)
    gmsh.logger.start()
    try:
        with silent():
            gmsh.merge(str(path))  # `open` would forget the values
        errors = [line for line in gmsh.logger.get() if line.startswith("Error")]
    finally:
        gmsh.logger.stop()
        gmsh.option.setNumber("General.AbortOnError", stop)
    if errors:
        raise SceneError(f"gmsh: {errors[0].removeprefix('Error').lstrip(' :')}")
    for name, value in given.items():
        text = isinstance(value, str)
        if len(gmsh.parser.getNumber(name) if text else gmsh.parser.getString(name)):
            raise SceneError(
                f"read_geo: the parameter '{name}' of '{path}' must be a "
                f"{'number' if text else 'text'}, got {shown(value)}."
            )


def mesh_model(
    gmsh: Any, path: str | Path, size: float | None, order: int | None, metres: float
) -> list[str]:
    """Mesh gmsh's model, unless there is a mesh already that is as asked for; texts of warnings.

    The largest edge, in the model's unit of some metres, and the order of the geometry are the
    model's own if None. `SceneError` if gmsh cannot mesh it.
    """
    mesh = gmsh.model.mesh
    own = size is not None or not len(mesh.getElements(3)[0])
    if size is not None:
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    if own:
        mesh.clear()
        try:
            mesh.generate(3)
        except Exception as error:  # gmsh raises nothing else
            raise SceneError(
                f"gmsh finds no mesh: {error}. Smaller cells (size; in read_cad also "
                "per_circle=24, along curves) often help; else the geometry needs repair."
            ) from None
    if order is not None:
        mesh.setOrder(order)
    told = [straighten(gmsh, metres)] if own or order == 2 else []
    if size is not None:
        told.append(_same(gmsh, Path(path).resolve(), size, metres))
    return [text for text in told if text]


def _same(gmsh: Any, path: Path, size: float, metres: float) -> str:
    """A warning if another size [unit of the model] gave the same mesh in this process."""
    _, x, _ = gmsh.model.mesh.getNodes()
    digest = hashlib.sha1((x / np.ptp(x)).round(6).tobytes()).digest()
    before, mesh = LAST.get(path, (size, b""))
    LAST[path] = size, digest
    if mesh != digest or before == size:
        return ""
    return (
        f"The sizes {metres * before:g} m and {metres * size:g} m give the same mesh. gmsh makes "
        "no cells larger than a tenth of the geometry's diagonal, and smaller ones at short edges. "
        "Only smaller sizes give finer meshes."
    )


def check_order(owner: str, order: int | None) -> None:
    """Refuse an order that cells cannot have: it is 1, 2 or None."""
    if order not in (None, 1, 2):
        raise SceneError(f"{owner}: order must be 1 or 2, got {shown(order)}.")


def _check_parameters(path: Path, given: Mapping[str, float | str]) -> None:
    """Refuse parameters that a script does not define."""
    known = _constants(_text(path))
    unknown = [name for name in given if name not in known]
    if unknown:
        raise SceneError(
            f"read_geo: '{path}' has no parameter '{unknown[0]}'. It defines by DefineConstant: "
            f"{', '.join(known) or 'none'}."
        )


def _text(path: Path, above: tuple[Path, ...] = ()) -> str:
    """The text of a script, and of those it includes but those `above` it, without comments."""
    path = path.resolve()
    if path in above or not path.is_file():
        return ""
    text = decoded(path.read_bytes())
    text = re.sub(
        r'("(?:\\.|[^"\\])*")|//[^\n]*|/\*.*?\*/', lambda m: m[1] or " ", text, flags=re.DOTALL
    )
    included = re.findall(r'\b(?:Include|Merge)\s*"([^"]+\.geo)"', text)
    return text + "".join(_text(path.parent / name, (*above, path)) for name in included)


def _constants(text: str) -> list[str]:
    """Names that the DefineConstant commands of a script define."""
    text = re.sub(r'"(?:\\.|[^"\\])*"', '""', text)
    inner = re.compile(r"\{[^{}]*\}|\([^()]*\)")
    while inner.search(text):
        text = inner.sub("", text)
    bodies = re.findall(r"\bDefineConstant\s*\[([^\]]*)\]", text)
    names = [name for body in bodies for name in re.findall(r"(\w+)\s*(?:=|,|$)", body)]
    return list(dict.fromkeys(names))
