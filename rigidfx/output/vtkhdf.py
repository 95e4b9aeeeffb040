"""One file with all times of the fields: VTKHDF, which ParaView, VTK from 9.3 on and h5py read.

Values of each time are behind those of the time before; whole numbers that have not changed are not
there again. Displacements are in double, all else in single precision; symmetric tensors have VTK's
xx, yy, zz, xy, yz, xz. The file of a run that was killed opens with all times.
https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format tells the format.
"""

from collections.abc import Mapping
from io import DEFAULT_BUFFER_SIZE
from pathlib import Path
from typing import Any
from weakref import finalize

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.flexible.stress import SYMMETRIC
from rigidfx.output.paraview import Body, Cloud
from rigidfx.output.whole_writes import ChangedFile, WholeWrites, uninterrupted

Array = npt.NDArray[Any]

DOUBLE = ("displacement",)  # small strains are differences of large displacements
ROWS = 64  # times in a chunk of their table
NOUGHT = np.zeros((), np.int64)
# Tables with a row for each time, and the row of a mesh that stays.
STEPS: dict[str, Array] = {
    "Values": np.zeros(()),
    "PartOffsets": NOUGHT,
    "PointOffsets": NOUGHT,
    "NumberOfParts": np.ones((), np.int64),
    "CellOffsets": NOUGHT[None],
    "ConnectivityIdOffsets": NOUGHT[None],
}


def hdf(owner: str) -> Any:
    """The module h5py, or a `SceneError` that says who needs it."""
    try:
        import h5py
    except ImportError:
        raise SceneError(
            f"{owner}: VTKHDF needs the Python module h5py (pip install h5py)."
        ) from None
    return h5py


class HdfSeries:
    """Writes a .vtkhdf file, time by time; used on rank 0 only.

    Attributes:
        path: The file, whole after each time.
    """

    @uninterrupted()
    def __init__(self, path: Path, body: Body | Cloud, kept: tuple[int, int] = (0, 0)) -> None:
        """Replace a former file, or go on with so many `kept` times; without h5py it is refused."""
        h5py = hdf("Recorder")
        self.path, self._count = path, 0
        former = path.with_suffix(".former.vtkhdf")
        if kept[0] and not former.exists():  # else a kill has come while it was copied
            _check(h5py, path, kept[0])
            path.rename(former)
        self._last: dict[str, tuple[Array | None, int]] = {}  # values of a field, and their place
        self._disk = WholeWrites(path)
        self._file = h5py.File(
            self._disk, "w", libver="earliest", meta_block_size=DEFAULT_BUFFER_SIZE
        )
        # A file that h5py has not closed when Python ends would call a Python that is gone.
        self._end = finalize(self, _ended, self._file, self._disk)
        root = self._root = self._file.create_group("VTKHDF")
        root.attrs["Version"] = np.array((2, 0), np.int64)  # the first with times
        root.attrs.create("Type", np.bytes_("UnstructuredGrid"))
        root["Points"] = body.points
        root["Connectivity"] = body.cells.reshape(-1).astype(np.int64)
        root["Offsets"] = np.arange(len(body.cells) + 1, dtype=np.int64) * body.cells.shape[1]
        root["Types"] = np.full(len(body.cells), body.vtk_type, np.uint8)
        sizes = {
            "NumberOfPoints": len(body.points),
            "NumberOfCells": len(body.cells),
            "NumberOfConnectivityIds": body.cells.size,
        }
        for name, size in sizes.items():
            root[name] = np.array([size], np.int64)
        root.create_group("Steps").attrs["NSteps"] = np.int64(0)
        self._tables = {name: self._table(f"Steps/{name}", of) for name, of in STEPS.items()}
        for kind in ("Point", "Cell"):
            root.create_group(f"{kind}Data")
            root.create_group(f"Steps/{kind}DataOffsets")
        self._file.flush()
        self._disk.commit()
        if kept[0]:
            with h5py.File(former, "r") as file:
                self._copy(file["VTKHDF"], kept[0])
        former.unlink(missing_ok=True)

    def _table(self, name: str, row: Array, at_once: int = ROWS) -> Any:
        """A new table of rows like one, empty."""
        most, chunk = (None, *row.shape), (at_once, *row.shape)
        return self._root.create_dataset(
            name, (0, *row.shape), row.dtype, maxshape=most, chunks=chunk
        )

    def _copy(self, root: Any, count: int) -> None:
        """Copy times of a former file."""
        sizes = {"Point": len(root["Points"]), "Cell": len(root["Types"])}
        for k in range(count):
            both = []
            for kind, size in sizes.items():
                places = root[f"Steps/{kind}DataOffsets"]
                at = {name: int(places[name][k]) for name in root[f"{kind}Data"]}
                data = root[f"{kind}Data"]
                both.append({name: data[name][i : i + size] for name, i in at.items()})
            self.write(float(root["Steps/Values"][k]), *both)

    def kept(self) -> tuple[int, int]:
        """How many times there are; and nothing more, as of `Series`."""
        return self._count, 0

    @uninterrupted()
    def write(self, t: float, points: Mapping[str, Array], cells: Mapping[str, Array]) -> None:
        """Add a time [s], with values by name of shape (nodes or cells,), (…, 3) or (…, 3, 3).

        Names are the same each time. Where an `OSError` is raised the file is as before.
        """
        rows = {"Values": np.array(t)}
        for kind, fields in (("Point", points), ("Cell", cells)):
            for name, values in fields.items():
                place = self._placed(f"{kind}Data/{name}", _stored(name, values))
                rows[f"{kind}DataOffsets/{name}"] = np.array(place)
        for name, row in (STEPS | rows).items():
            if name not in self._tables:
                self._tables[name] = self._table(f"Steps/{name}", row)
            _put(self._tables[name], self._count, row[None])
        self._root["Steps"].attrs["NSteps"] = np.int64(self._count + 1)
        self._file.flush()
        self._disk.commit()
        self._count += 1

    def _placed(self, name: str, values: Array) -> int:
        """Add the values of a field behind those of the time before; the place where they begin.

        Whole numbers that have not changed are there already.
        """
        if name not in self._tables:
            row = np.zeros(values.shape[1:], values.dtype)
            at_once = DEFAULT_BUFFER_SIZE // max(row.nbytes, 1)
            self._tables[name] = self._table(name, row, max(at_once, len(values)))
        last, place = self._last.get(name, (None, -len(values)))
        if last is None or not np.array_equal(last, values):
            place += len(values)
            _put(self._tables[name], place, values)
            self._last[name] = None if values.dtype.kind == "f" else values, place
        return place

    def close(self) -> None:
        """Close the file."""
        self._end()


def _put(table: Any, place: int, rows: Array) -> None:
    """Put rows from a place on, behind all others."""
    table.resize(place + len(rows), axis=0)
    table[place:] = rows


def _check(h5py: Any, path: Path, count: int) -> None:
    """Refuse a file that has fewer times, or is none."""
    try:
        with h5py.File(path, "r") as file:
            there = int(file["VTKHDF/Steps"].attrs["NSteps"])
    except (OSError, KeyError, ValueError):
        there = 0
    if there < count:
        raise ChangedFile(path, "times that were there are gone")


@uninterrupted()
def _ended(file: Any, disk: WholeWrites) -> None:
    """Close a file of h5py, and its bytes."""
    try:
        file.close()
        disk.commit()
    finally:
        disk.close()


def _stored(name: str, values: Array) -> Array:
    """Values as the file has them."""
    if values.ndim == 3:  # symmetric tensors
        values = values.reshape(-1, 9).take([3 * i + j for i, j in SYMMETRIC], axis=1)
    if values.dtype.kind == "f" and name not in DOUBLE:
        values = values.astype(np.float32)
    return np.ascontiguousarray(values)
