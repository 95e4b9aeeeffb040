"""The fields of a recorder's run as arrays of NumPy, and as meshes of pyvista."""

import xml.etree.ElementTree as ET
import zlib
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import OutputError, RigidfxError, SceneError
from rigidfx.base.inputs import number, path_of, shown
from rigidfx.flexible.stress import tensors
from rigidfx.output.paraview import Body
from rigidfx.output.vtkhdf import hdf

Array = npt.NDArray[Any]
Values = dict[str, Array]

FILES = ("fields.vtkhdf", "fields.pvd")  # of a recorder, in the order of preference


class _File(ABC):
    """A file with times."""

    times: list[float]
    points: Array
    cells: Array
    vtk_type: int

    @abstractmethod
    def read(self, k: int, only: str = "") -> tuple[Values, Values]:
        """Fields on the nodes and on the cells at the time of this number; or one field only."""


class _Hdf(_File):
    """A .vtkhdf; it is open only while something is read."""

    def __init__(self, path: Path) -> None:
        self._path, self._h5py = path, hdf("read_fields")
        with self._h5py.File(path, "r") as file:
            root = file["VTKHDF"]
            self._count = int(root["Steps"].attrs["NSteps"])
            self.times = root["Steps/Values"][: self._count].tolist()
            self.points, types = root["Points"][()], root["Types"]
            self._sizes = {"Point": len(self.points), "Cell": len(types)}
            self.cells = root["Connectivity"][()].reshape(len(types), -1)
            self.vtk_type = int(types[0])

    def read(self, k: int, only: str = "") -> tuple[Values, Values]:
        with self._h5py.File(self._path, "r") as file:
            root = file["VTKHDF"]
            return self._of(root, "Point", k, only), self._of(root, "Cell", k, only)

    def _of(self, root: Any, kind: str, k: int, only: str) -> Values:
        out = {}
        for name, data in root[f"{kind}Data"].items():
            if only not in ("", name):
                continue
            first = int(root[f"Steps/{kind}DataOffsets/{name}"][k])
            out[name] = data[first : first + self._sizes[kind]]
        return out


class _Pvd(_File):
    """A .pvd and its .vtu files, as `rigidfx.output.paraview` writes them."""

    def __init__(self, path: Path) -> None:
        entries = [*ET.parse(path).getroot().iter("DataSet")]
        self.times = [float(entry.attrib["timestep"]) for entry in entries]
        self._files = [path.parent / entry.attrib["file"] for entry in entries]
        if not entries:
            return
        first = self._arrays(0)
        self.points, cells = first["Points"]["points"], first["Cells"]
        self.cells = cells["connectivity"].reshape(len(cells["types"]), -1)
        self.vtk_type = int(cells["types"][0])

    def read(self, k: int, only: str = "") -> tuple[Values, Values]:
        arrays = self._arrays(k, only)
        return arrays["PointData"], arrays["CellData"]

    def _arrays(self, k: int, only: str = "") -> dict[str, Values]:
        """Arrays of a .vtu, by the parts of the file that they are in."""
        head, data = self._files[k].read_bytes().split(b'<AppendedData encoding="raw">\n_', 1)
        piece = ET.fromstring(head + b"</VTKFile>").find("UnstructuredGrid/Piece")
        assert piece is not None
        out: dict[str, Values] = {}
        for part in piece:
            named = [(a.attrib["Name"], a) for a in part]
            out[part.tag] = {n: _unpacked(a, data) for n, a in named if only in ("", n)}
        return out


def _unpacked(array: ET.Element, data: bytes) -> Array:
    """An array of a .vtu from its appended data: see `rigidfx.output.paraview`."""
    start, kind = int(array.attrib["offset"]), array.attrib["type"].lower()  # float64, say
    head = np.frombuffer(data, "<u8", 4, start)
    raw = zlib.decompress(data[start + head.nbytes :][: int(head[3])])
    values = np.frombuffer(raw, np.dtype(kind).newbyteorder("<"))
    width = int(array.attrib["NumberOfComponents"])
    return values if width == 1 else values.reshape(-1, width)


@dataclass(frozen=True)
class RecordedFields:
    """The fields of a run: those of all times by name, or all of a time.

    Values are read when they are asked for: `fields["displacement"]` those of all times at once,
    `fields.at(t)` those of one. Vectors have shape (…, 3), stresses and strains (…, 3, 3).

    Attributes:
        times: When they were written, shape (times,) [s].
        points: Reference positions of the nodes, shape (nodes, 3) [m].
        cells: Nodes of each cell in VTK's order, shape (cells, nodes of each).
        vtk_type: VTK's number of the cell type.
        on_nodes: Names of the fields on nodes.
        on_cells: Names of the fields on cells.
    """

    times: Array
    points: Array
    cells: Array
    vtk_type: int
    on_nodes: tuple[str, ...]
    on_cells: tuple[str, ...]
    _file: _File

    def __getitem__(self, name: str) -> Array:
        """A field at all times, shape (times, nodes or cells, …).

        Raises:
            SceneError: If there is no such field.
        """
        if name not in (*self.on_nodes, *self.on_cells):
            raise SceneError(
                f"read_fields: there is no field {shown(name)}. On nodes: "
                f"{', '.join(self.on_nodes)}; on cells: {', '.join(self.on_cells) or 'none'}."
            )
        every = [self._read(k, name) for k in range(len(self.times))]
        return np.stack([{**cells, **nodes}[name] for nodes, cells in every])

    def at(self, t: float | None = None) -> Values:
        """All fields by name at the written time that is nearest.

        Args:
            t: Time [s]; the last one if None.

        Raises:
            SceneError: If it is no number.
        """
        nodes, cells = self._read(self._nearest(t))
        return {**cells, **nodes}

    def mesh(self, t: float | None = None, *, scale: float = 0.0) -> Any:
        """All fields on a mesh of pyvista, an `UnstructuredGrid`.

        Args:
            t: As in `at`.
            scale: Factor of the displacements that move its points: 1 for the deformed body, 0
                for the undeformed one.

        Raises:
            SceneError: If there is no pyvista, or an argument is no number.
        """
        factor, k = number("read_fields", "scale", scale), self._nearest(t)
        nodes, cells = self._read(k)
        grid = self.body()
        if factor:
            grid.points = self.points + factor * nodes["displacement"]
        for data, fields in ((grid.point_data, nodes), (grid.cell_data, cells)):
            for name, values in fields.items():
                data[name] = values.reshape(len(values), -1) if values.ndim > 2 else values
        grid.field_data["TimeValue"] = [self.times[k]]
        return grid

    def body(self) -> Any:
        """The undeformed mesh without fields, an `UnstructuredGrid` of pyvista.

        Raises:
            SceneError: If there is no pyvista.
        """
        return grid_of(self)

    def _nearest(self, t: float | None) -> int:
        if t is None:
            return len(self.times) - 1
        return int(np.abs(self.times - number("read_fields", "t", t)).argmin())

    def _read(self, k: int, only: str = "") -> tuple[Values, Values]:
        try:
            found = self._file.read(k, only)
        except (OSError, KeyError, ValueError, zlib.error, ET.ParseError) as error:
            raise OutputError(
                f"read_fields: the fields of t = {self.times[k]:g} s cannot be read: {error}."
            ) from error
        return _whole(found[0]), _whole(found[1])


def _whole(fields: Values) -> Values:
    """Fields with tensors of shape (…, 3, 3)."""
    out = dict(fields)
    for name, values in fields.items():
        if values.ndim == 2 and values.shape[1] in (6, 9):
            six = values.shape[1] == 6
            out[name] = tensors(values) if six else values.reshape(-1, 3, 3)
    return out


def grid_of(body: Body | RecordedFields) -> Any:
    """A body without fields, an `UnstructuredGrid` of pyvista, which has to be there."""
    try:
        import pyvista
    except ImportError:
        raise SceneError("read_fields: a mesh needs pyvista (pip install pyvista).") from None
    table = np.insert(body.cells, 0, body.cells.shape[1], axis=1).reshape(-1)
    types = np.full(len(body.cells), body.vtk_type, np.uint8)
    return pyvista.UnstructuredGrid(table, types, body.points)


def read_fields(path: str | Path) -> RecordedFields:
    """The fields that a `Recorder` has written, as arrays of NumPy and meshes of pyvista.

    Example:
        >>> fields = rf.read_fields("out/run")                    # doctest: +SKIP
        >>> fields["displacement"][-1]    # at the last time, shape (nodes, 3)
        >>> fields.at(0.2)["von_mises"].max()
        >>> fields.mesh(0.2, scale=1).plot(scalars="von_mises")

    Args:
        path: The recorder's folder, or a .vtkhdf or .pvd in it, points.pvd, say. The run may go on,
            or was killed.

    Raises:
        OutputError: If there are no fields, or they cannot be read.
        SceneError: If path is none, or h5py is missing for a .vtkhdf.
    """
    path = path_of("read_fields", "path", path)
    if path.is_dir():
        path = next((p for p in map(path.joinpath, FILES) if p.exists()), path / FILES[-1])
    kind = {".vtkhdf": _Hdf, ".pvd": _Pvd}.get(path.suffix)
    if kind is None:
        raise OutputError(f"read_fields: '{path}' is neither a folder nor a .vtkhdf or .pvd.")
    if not path.is_file():
        raise OutputError(
            f"read_fields: there is no file '{path}'. A Recorder writes it, with the first fields."
        )
    try:
        file: _File = kind(path)
        nodes, cells = file.read(0) if file.times else ({}, {})
    except RigidfxError:
        raise
    except (OSError, KeyError, ValueError, zlib.error, ET.ParseError) as error:
        raise OutputError(
            f"read_fields: '{path}' cannot be read: no file of a Recorder, or a damaged one "
            f"({' '.join(str(error).split())})."
        ) from error
    if not file.times:
        raise OutputError(f"read_fields: '{path}' has no time yet.")
    mesh = file.points, file.cells, file.vtk_type
    return RecordedFields(np.array(file.times), *mesh, tuple(nodes), tuple(cells), file)
