"""One file with all times of the fields: VTKHDF, which ParaView, VTK from 9.3 on and h5py read.

Points and cells are there once, the values of each time behind those of the time before; whole
numbers that have not changed since are not there again. Displacements are in double precision, all
else is in single precision; tensors have the six components xx, yy, zz, xy, yz, xz of VTK's
symmetric ones. Rank 0 alone writes, by h5py. The file of a run that was killed opens with all times
that were written.

The format: https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from io import DEFAULT_BUFFER_SIZE
from pathlib import Path
from typing import Any
from weakref import finalize

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.flexible.stress import SYMMETRIC
from rigidfx.output.paraview import Body, Cloud
from rigidfx.output.whole_writes import ChangedFile, WholeWrites

Array = npt.NDArray[Any]

DOUBLE = ("displacement",)  # small strains are differences of large displacements
ROWS = 64  # times in a chunk of their table, and for which datasets are made longer at once


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay a SIGINT to the end. Other threads get none in any case."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before is None:
        yield
        return
    heard: list[int] = []
    signal.signal(signal.SIGINT, lambda number, frame: heard.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if heard:
            signal.raise_signal(signal.SIGINT)


def hdf(owner: str) -> Any:
    """The module h5py.

    Args:
        owner: Who needs it, for the message.

    Raises:
        SceneError: If there is none.
    """
    try:
        import h5py
    except ImportError:
        raise SceneError(
            f"{owner}: VTKHDF needs the Python module h5py (pip install h5py)."
        ) from None
    return h5py


class _Chunks:
    """Rows of a dataset, in chunks that are written as they are.

    The first rows of a chunk make it. Others are put where it lies, without h5py, whose ways take
    several times as long; that counts where there are few cells.
    """

    def __init__(self, disk: WholeWrites, data: Any) -> None:
        """There are no rows."""
        self._disk, self._data = disk, data
        self._rows, *self.rest = data.chunks
        self._none = (0,) * len(self.rest)
        self._place: int | None = None  # of the last chunk in the file

    def put(self, row: int, values: Array) -> None:
        """Put rows behind all others, all of them in one chunk; those between stay empty."""
        at, size = row % self._rows, values.nbytes // len(values)
        if at and self._place is not None:
            self._disk.put(self._place + at * size, values)
            return
        first = row - at, *self._none
        if self._rows == len(values):
            self._data.id.write_direct_chunk(first, values)
            return
        chunk = np.zeros(self._data.chunks, values.dtype)
        chunk[at : at + len(values)] = values
        self._data.id.write_direct_chunk(first, chunk)
        self._place = self._data.id.get_chunk_info_by_coord(first).byte_offset

    def resize(self, rows: int) -> None:
        """Set the number of rows."""
        self._data.id.set_extent((rows, *self.rest))


class _Table:
    """A table with a row for each time, with or without a number.

    Some rows that are still empty follow the last one, as each change of its length is written,
    too.
    """

    def __init__(
        self,
        disk: WholeWrites,
        group: Any,
        name: str,
        rest: tuple[int, ...] = (),
        kind: Any = np.int64,
        all: int = 0,
        at_once: int = ROWS,
    ) -> None:
        """Make it, empty; `all` is the value of empty rows, `at_once` how many are added."""
        self.data = group.create_dataset(
            name, (0, *rest), kind, maxshape=(None, *rest), chunks=(ROWS, *rest), fillvalue=all
        )
        self._chunks, self._kind, self._only_noughts = _Chunks(disk, self.data), kind, True
        self.rows, self._at_once = 0, at_once

    def enter(self, row: int, value: float) -> None:
        """Put a value into the last row; nought is there already until there is another one."""
        self.more(row)
        self._only_noughts &= value == 0
        if not self._only_noughts:
            self._chunks.put(row, np.array([value], self._kind))

    def more(self, row: int) -> None:
        """Add rows up to a last one."""
        self.rows = row + 1
        if row % self._at_once == 0:
            self._chunks.resize(row + self._at_once)

    def cut(self) -> None:
        """Leave out what follows the last row."""
        self._chunks.resize(self.rows)


@dataclass
class _Field:
    """A field in the file.

    Attributes:
        chunks: Its values, those of a time behind those of the time before.
        places: Where the values of each time begin.
        may_stay: Whether values that have not changed are not added again.
        last: The last values that were added, then ...
        place: ... where they begin ...
        rows: ... and end.
        length: Of the values, with empty rows behind.
    """

    chunks: _Chunks
    places: _Table
    may_stay: bool
    last: Array | None
    place: int
    rows: int
    length: int

    def add(self, values: Array) -> None:
        """Add the values of a time behind all others."""
        self.last = values if self.may_stay else None
        self.place, self.rows = self.rows, self.rows + len(values)
        if self.rows > self.length:
            self.length = self.place + ROWS * len(values)
            self.chunks.resize(self.length)
        if len(values):
            self.chunks.put(self.place, values)

    def cut(self) -> None:
        """Leave out what follows the last values."""
        self.chunks.resize(self.rows)
        self.places.cut()


class HdfSeries:
    """Writes a .vtkhdf file, time by time; used on rank 0 only.

    Attributes:
        path: The file, whole after each time.
    """

    @uninterrupted()
    def __init__(self, path: Path, body: Body | Cloud, kept: tuple[int, int] = (0, 0)) -> None:
        """Replace a former file of that name, or go on with its times.

        Args:
            path: The file.
            body: Points and cells.
            kept: Of `kept`: how many times of a former file are copied.

        Raises:
            OSError: If it cannot be written.
            SceneError: If there is no h5py.
        """
        h5py = hdf("Recorder")
        self.path = path
        self._count = 0
        former = path.with_suffix(".former.vtkhdf")
        if kept[0] and not former.exists():  # else a kill has come while it was copied
            _check(h5py, path, kept[0])
            path.rename(former)
        self._fields: dict[tuple[str, str], _Field] = {}
        self._disk = WholeWrites(path)
        self._file = h5py.File(
            self._disk, "w", libver="earliest", meta_block_size=DEFAULT_BUFFER_SIZE
        )
        # A file that h5py has not closed when Python ends would call a Python that is gone.
        self._end = finalize(self, _ended, self._file, self._disk)
        root = self._root = self._file.create_group("VTKHDF")
        root.attrs["Version"] = np.array((2, 0), np.int64)  # the first with times
        root.attrs.create("Type", np.bytes_("UnstructuredGrid"))
        width = body.cells.shape[1]
        root["Points"] = body.points
        root["Connectivity"] = body.cells.reshape(-1).astype(np.int64)
        root["Offsets"] = np.arange(len(body.cells) + 1, dtype=np.int64) * width
        root["Types"] = np.full(len(body.cells), body.vtk_type, np.uint8)
        sizes = {
            "NumberOfPoints": len(body.points),
            "NumberOfCells": len(body.cells),
            "NumberOfConnectivityIds": body.cells.size,
        }
        for name, size in sizes.items():
            root[name] = np.array([size], np.int64)
        self._steps = steps = root.create_group("Steps")
        steps.attrs["NSteps"] = np.int64(0)
        self._written = h5py.h5a.open(steps.id, b"NSteps")
        # VTK makes space for the times that there are, and reads the whole table into it.
        self._times = _Table(self._disk, steps, "Values", (), np.float64, at_once=1)
        # Tables with the same numbers are one table by several names.
        nought = _Table(self._disk, steps, "PartOffsets")
        of_cells = _Table(self._disk, steps, "CellOffsets", (1,))
        steps["PointOffsets"], steps["ConnectivityIdOffsets"] = nought.data, of_cells.data
        self._alike = nought, of_cells, _Table(self._disk, steps, "NumberOfParts", all=1)
        for kind in ("Point", "Cell"):
            root.create_group(f"{kind}Data")
            steps.create_group(f"{kind}DataOffsets")
        self._commit()
        if kept[0]:
            with h5py.File(former, "r") as file:
                self._copy(file["VTKHDF"], kept[0])
        former.unlink(missing_ok=True)

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
        """Add a time.

        Args:
            t: Time [s].
            points: Name → values on the nodes, shape (nodes,), (nodes, 3) or (nodes, 3, 3), the
                same names each time.
            cells: Name → values on the cells, likewise.

        Raises:
            OSError: If they cannot be written; the file is as before then.
        """
        for kind, fields in (("Point", points), ("Cell", cells)):
            for name, values in fields.items():
                self._add(kind, name, values)
        self._times.enter(self._count, t)
        for table in self._alike:
            table.more(self._count)
        self._written.write(np.array(self._count + 1))
        self._commit()
        self._count += 1

    def _add(self, kind: str, name: str, values: Array) -> None:
        """Add the values of a field, or where they are already."""
        values = _stored(name, values)
        field = self._fields.get((kind, name)) or self._made(kind, name, values)
        if field.last is None or not np.array_equal(field.last, values):
            field.add(values)
        if field.places.rows == self._count:  # not for another field of the same table
            field.places.enter(self._count, field.place)

    def _made(self, kind: str, name: str, values: Array) -> _Field:
        """A new field; those of real numbers share a table of places, as all change."""
        rest = values.shape[1:]
        times = max(DEFAULT_BUFFER_SIZE // max(values.nbytes, 1), 1)  # a new chunk takes longer
        chunk = (max(min(times, ROWS) * len(values), 1), *rest)
        data = self._root[f"{kind}Data"].create_dataset(
            name, (0, *rest), values.dtype, maxshape=(None, *rest), chunks=chunk
        )
        offsets, may_stay = self._steps[f"{kind}DataOffsets"], values.dtype.kind != "f"
        shared = [f.places for (k, _), f in self._fields.items() if k == kind and not f.may_stay]
        if shared and not may_stay:
            places, offsets[name] = shared[0], shared[0].data
        else:
            places = _Table(self._disk, offsets, name)
        return self._fields.setdefault(
            (kind, name), _Field(_Chunks(self._disk, data), places, may_stay, None, 0, 0, 0)
        )

    def _commit(self) -> None:
        self._file.flush()
        self._disk.commit()

    def close(self) -> None:
        """Close the file.

        Raises:
            OSError: If it cannot be written to its end.
        """
        if self._end.alive:
            for table in (self._times, *self._alike):
                table.cut()
            for field in self._fields.values():
                field.cut()
        self._end()


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
