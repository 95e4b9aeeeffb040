"""ParaView series: point and cell data of the whole body, the same files from any number of ranks.

A series is a .pvd that lists one .vtu per time. Rank 0 writes the whole body: cells in the order of
the mesh file, each node once, no ghosts. The .pvd names finished files only, so it can be opened
while a run goes on. DOLFINx's VTKFile shows ghost cells and completes the .pvd at the end only;
VTXWriter of DOLFINx 0.9 cannot join point and cell data.
"""

import os
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from errno import ENOSPC
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt
from dolfinx import fem, plot

from rigidfx.base.types import Indices
from rigidfx.output.whole_writes import ChangedFile

Array = npt.NDArray[Any]

HEAD = b'<VTKFile type="Collection" version="0.1">\n<Collection>\n'
END = b"</Collection>\n</VTKFile>\n"
VTK_NAMES = {"f": "Float", "i": "Int", "u": "UInt"}


class Body:
    """Brings values on nodes and cells from all ranks to rank 0.

    Cells are ordered by their number in the mesh file, nodes by their first appearance in them, so
    that the result does not depend on the number of ranks.

    Attributes:
        points: Reference positions, shape (nodes, 3) [m]; empty but on rank 0.
        cells: Nodes of each cell in VTK's order, shape (cells, nodes each); empty but on rank 0.
        vtk_type: VTK's number of the cell type.
    """

    def __init__(self, space: Any, parts: Indices | None = None) -> None:
        """Number cells and nodes of a Lagrange space. Collective.

        Where `parts`, a number for each owned cell, meet, each has a node of its own.
        """
        self._comm = space.mesh.comm
        self._owned_nodes = int(space.dofmap.index_map.size_local)
        self._owned_cells = int(space.mesh.topology.index_map(3).size_local)
        table, types, X = plot.vtk_mesh(space)
        corners = space.dofmap.dof_layout.num_dofs
        local = table.reshape(-1, corners + 1)[: self._owned_cells, 1:]
        known = space.dofmap.index_map.local_to_global(local.reshape(-1).astype(np.int32))
        numbers = space.mesh.topology.original_cell_index[: self._owned_cells]
        self._order = np.argsort(self._gather(np.asarray(numbers)))
        nodes = self._gather(known.reshape(-1, corners))[self._order]
        if parts is not None:
            of = self._gather(parts[: self._owned_cells])[self._order]
            nodes = nodes + of[:, None].astype(np.int64) * space.dofmap.index_map.size_global
        used, first, inverse = np.unique(nodes, return_index=True, return_inverse=True)
        appearance = np.argsort(first)
        rank = np.empty_like(appearance)
        rank[appearance] = np.arange(appearance.size)
        self._nodes = used[appearance] % space.dofmap.index_map.size_global
        self._parts = used[appearance] // space.dofmap.index_map.size_global
        self.cells = rank[inverse.reshape(-1)].reshape(nodes.shape).astype(np.int32)
        self.points = self.on_nodes(X)
        self.vtk_type = max(self._comm.allgather(int(types[0]) if len(types) else 0))

    def _gather(self, values: Array) -> Array:
        """Rows of all ranks on rank 0; no rows elsewhere."""
        parts = self._comm.gather(values, root=0)
        return np.concatenate(parts) if parts else values[:0]

    def on_nodes(self, values: fem.Function | Array) -> Array:
        """Nodal vectors of a function, or of local nodes, on rank 0. Collective."""
        local = values if isinstance(values, np.ndarray) else values.x.array.reshape(-1, 3)
        return self._gather(local[: self._owned_nodes])[self._nodes]

    def on_nodes_of_parts(self, values: Array) -> Array:
        """Values (parts, local nodes, …) on rank 0, a row for each part's nodes. Collective."""
        gathered = np.stack([self._gather(part[: self._owned_nodes]) for part in values])
        return np.asarray(gathered[self._parts, self._nodes])

    def on_cells(self, values: Array) -> Array:
        """Values per local cell, owned ones first, on rank 0. Collective."""
        return self._gather(values[: self._owned_cells])[self._order]


@dataclass(frozen=True)
class Cloud:
    """Points, each a cell of its own."""

    points: Array  # reference positions, shape (points, 3) [m]; empty but on rank 0
    cells: Array  # number of each point, shape (points, 1)
    vtk_type: int = 1  # VTK's number of a vertex


class Series:
    """Writes a .pvd and its .vtu files; used on rank 0 only.

    Attributes:
        path: The .pvd, whole after each time.
    """

    def __init__(self, path: Path, body: Body | Cloud, kept: tuple[int, int] = (0, 0)) -> None:
        """Replace a former series, .vtu in a folder beside the .pvd, or go on with times `kept`."""
        self.path = path
        self._files = path.with_suffix("")
        self._count, self._end = kept  # times, and where the .pvd's next one goes
        self._body = {
            "points": _pack(body.points.astype("<f8")),
            "connectivity": _pack(body.cells.astype("<i4")),
            "offsets": _pack(np.cumsum([body.cells.shape[1]] * len(body.cells)).astype("<i4")),
            "types": _pack(np.full(len(body.cells), body.vtk_type, np.uint8)),
        }
        self._size = len(body.points), len(body.cells)
        self._files.mkdir(exist_ok=True)
        if self._count:
            if path.stat().st_size < self._end:
                raise ChangedFile(path, "times that were there are gone")
            os.truncate(path, self._end)
            with path.open("ab") as file:
                file.write(END)
        else:
            path.unlink(missing_ok=True)
        # Among them may be a .vtu.part that a kill has left.
        stays = {f"{path.stem}_{k:06d}.vtu" for k in range(self._count)}
        for stale in self._files.glob(f"{path.stem}_[0-9]*.vtu*"):
            if stale.name not in stays:
                stale.unlink()

    def kept(self) -> tuple[int, int]:
        """How many times there are, and where the last entry of the .pvd ends [bytes]."""
        return self._count, self._end

    def write(self, t: float, points: Mapping[str, Array], cells: Mapping[str, Array]) -> None:
        """Add a time [s], with values by name of shape (nodes or cells,), (…, 3) or (…, 3, 3)."""
        file = self._files / f"{self.path.stem}_{self._count:06d}.vtu"
        _replace(file, self._vtu(points, cells))
        name = quoteattr(f"{self._files.name}/{file.name}")
        self._list(f'<DataSet timestep="{t!r}" part="0" file={name}/>\n'.encode())
        self._count += 1

    def close(self) -> None:
        """Nothing to do: each file is whole and closed."""

    def _list(self, entry: bytes) -> None:
        """Put an entry before the end of the .pvd, by one call of the system: wholly or not at all.

        Replacing the file would do as well, but then file systems wait for the disk.
        """
        if self._count == 0:
            _replace(self.path, HEAD + entry + END)
            self._end = len(HEAD + entry)
            return
        with self.path.open("r+b", buffering=0) as file:
            file.seek(self._end)
            try:
                if file.write(entry + END) < len(entry + END):
                    raise OSError(ENOSPC, "No space left on device", str(self.path))
            except OSError:
                file.seek(self._end)
                file.write(END)
                file.truncate()
                raise
        self._end += len(entry)

    def _vtu(self, points: Mapping[str, Array], cells: Mapping[str, Array]) -> bytes:
        blocks: list[bytes] = []

        def array(name: str, kind: str, width: int, block: bytes) -> str:
            offset = sum(map(len, blocks))
            blocks.append(block)
            return (
                f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{width}" '
                f'format="appended" offset="{offset}"/>'
            )

        def data(name: str, values: Array) -> str:
            values = values.astype(values.dtype.newbyteorder("<"))
            kind = f"{VTK_NAMES[values.dtype.kind]}{8 * values.dtype.itemsize}"
            level = 0 if kind.startswith("Float") else 1
            return array(name, kind, int(np.prod(values.shape[1:])), _pack(values, level))

        own = self._body
        # From version 2.1 on, VTK numbers the edges of second-order hexahedra as DOLFINx does.
        lines = [
            '<VTKFile type="UnstructuredGrid" version="2.2" byte_order="LittleEndian" '
            'header_type="UInt64" compressor="vtkZLibDataCompressor">',
            "<UnstructuredGrid>",
            f'<Piece NumberOfPoints="{self._size[0]}" NumberOfCells="{self._size[1]}">',
            "<PointData>",
            *(data(name, values) for name, values in points.items()),
            "</PointData>",
            "<CellData>",
            *(data(name, values) for name, values in cells.items()),
            "</CellData>",
            "<Points>",
            array("points", "Float64", 3, own["points"]),
            "</Points>",
            "<Cells>",
            array("connectivity", "Int32", 1, own["connectivity"]),
            array("offsets", "Int32", 1, own["offsets"]),
            array("types", "UInt8", 1, own["types"]),
            "</Cells>",
            "</Piece>",
            "</UnstructuredGrid>",
            '<AppendedData encoding="raw">',
        ]
        end = b"\n</AppendedData>\n</VTKFile>\n"
        return ("\n".join(lines) + "\n_").encode() + b"".join(blocks) + end


def _pack(values: Array, level: int = 1) -> bytes:
    """One compressed block with the header VTK expects: 1 block, its size, no rest, packed size.

    Level 0 only wraps: digits of results hardly compress, and the attempt would take most of the
    time of writing.
    """
    raw = np.ascontiguousarray(values).tobytes()
    packed = zlib.compress(raw, level)
    return np.array([1, len(raw), 0, len(packed)], "<u8").tobytes() + packed


def _replace(path: Path, content: bytes) -> None:
    """Write a file so that it is there wholly or not at all."""
    part = path.with_name(path.name + ".part")
    part.write_bytes(content)
    part.replace(path)
