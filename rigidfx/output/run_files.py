"""The files of a run in their folder, which begin anew or where they ended at a checkpoint.

Rows of tables are on the disk as soon as they are added, by one call of the system and wholly or
not at all: the file can be read while it grows, after a kill, and where the disk was full. One
process at a time writes a table. The lock is the system's: it ends with the process, however that
ends.

docs/columns.md lists the columns of events.csv and bodies.csv.
"""

import csv
import io
import logging
import os
import sys
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from errno import ENOENT, ENOSPC
from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

from rigidfx.base.errors import SceneError
from rigidfx.base.files import lock
from rigidfx.base.inputs import shown
from rigidfx.base.log import hearing
from rigidfx.output.history import components
from rigidfx.output.paraview import Body, Cloud, Series
from rigidfx.output.vtkhdf import HdfSeries, hdf
from rigidfx.output.whole_writes import ChangedFile
from rigidfx.report.report import BodyReport, Report

KINDS: dict[str, type[Series] | type[HdfSeries]] = {"pvd": Series, "vtkhdf": HdfSeries}
VIEW = Path(__file__).with_name("view.py")  # runs in ParaView's Python
EVENT = (
    *("t", "kind", "reason", "unknowns_before", "unknowns_after"),
    *("energy_frozen", "energy_released", "energy_lost", "work_of_supports", "work_of_motors"),
    *("linear_momentum_error", "angular_momentum_error"),
)
CHANGE = ("name", "number", "cells_before", "cells_after", "stored_before", "stored_after")
IMPULSES = ("impulse", "angular_impulse")
EVENT_COLUMNS = (*EVENT, *(f"{name}_{axis}" for name in IMPULSES for axis in "xyz"), *CHANGE)

BODY = ("number", "name", "cells", "shapes", "nu", "mass")
VECTORS = ("centre", "velocity", "angular_velocity", "rotation")
ENERGIES = ("kinetic", "stored", "strain")
BODY_COLUMNS = ("t", *BODY, *(f"{v}_{axis}" for v in VECTORS for axis in "xyz"), *ENERGIES)
LATER = {"events": EVENT_COLUMNS, "bodies": BODY_COLUMNS}  # tables that begin with their first row


def event_rows(report: Report) -> Iterator[dict[str, Any]]:
    """Rows of events.csv for the switches around a step."""
    for event in report.events:
        of_event = {name: getattr(event, name) for name in EVENT}
        for name in IMPULSES:
            of_event |= components(name, getattr(event, name))
        for change in event.changes:
            yield of_event | {name: getattr(change, name) for name in CHANGE}


def body_rows(report: Report) -> Iterator[dict[str, Any]]:
    """Rows of bodies.csv for the bodies of a report."""
    for body in report.bodies:
        row = {name: getattr(body, name) for name in (*BODY, *ENERGIES)}
        for name in VECTORS:
            row |= components(name, _vector(body, name))
        yield {"t": report.t} | row


def _vector(body: BodyReport, name: str) -> Any:
    if name == "rotation":
        return Rotation.from_matrix(body.orientation).as_rotvec()
    return getattr(body, name)


class CsvFile:
    """A CSV file that takes the place of a former one, or goes on; used on rank 0 only.

    Attributes:
        former: Whether it has rows of a former run.
    """

    def __init__(self, path: Path, columns: Sequence[str] = ()) -> None:
        """Lock the file, of columns or its first row's; `BlockingIOError` if it is open already."""
        self._columns, self._path, self._end, self._sum = [*columns], path, 0, 0
        self._file = open(path, "a+b", buffering=0)  # noqa: SIM115 - it stays open
        try:
            lock(self._file.fileno())
            self._named = bool(os.fstat(self._file.fileno()).st_nlink)  # some systems count none
            self._file.seek(0)
            self.former = self._file.read().count(b"\n") > 1
            if not self.former:
                self.begin(None)
        except OSError:
            self._file.close()
            raise

    def begin(self, kept: tuple[int, int] | None) -> None:
        """Empty the file, or cut it off where it ended if rows are `kept`, and not others."""
        end, known = kept or (0, 0)
        self._file.seek(0)
        if zlib.crc32(self._file.read(end)) != known:
            raise ChangedFile(self._path, "rows that were there are gone")
        self._file.truncate(end)
        self._end, self._sum = end, known
        if self._columns:
            self._head()

    def _head(self) -> None:
        """Write the names of the columns, or compare them with those that are there."""
        head = self._text(dict(zip(self._columns, self._columns, strict=True)))
        self._file.seek(0)
        if not self._end:
            self._append(head)
        elif self._file.read(len(head)) != head:
            raise ChangedFile(self._path, "its columns are not those of the recorder's options")

    def add(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Add rows; where an `OSError` is raised the file is as before, or was removed."""
        if self._named and not os.fstat(self._file.fileno()).st_nlink:
            raise OSError(ENOENT, "removed since the run began", str(self._path))
        every = [*rows]
        if every and not self._columns:
            self._columns = [*every[0]]
            self._head()
        self._append(self._text(*every))

    def _append(self, data: bytes) -> None:
        try:
            if self._file.write(data) < len(data):
                raise OSError(ENOSPC, "No space left on device", str(self._path))
        except OSError as error:
            self._file.truncate(self._end)
            raise OSError(error.errno, error.strerror, str(self._path)) from error
        self._end, self._sum = self._end + len(data), zlib.crc32(data, self._sum)

    def _text(self, *rows: Mapping[str, Any]) -> bytes:
        text = io.StringIO(newline="")
        csv.DictWriter(text, self._columns).writerows(rows)
        return text.getvalue().encode()

    def kept(self) -> tuple[int, int]:
        """Its length [bytes] and a sum over its content, once the disk has it."""
        os.fsync(self._file.fileno())
        return self._end, self._sum

    def close(self) -> None:
        """Close the file, which ends its lock."""
        self._file.close()


class LogFile(logging.FileHandler):
    """A file with times, whose errors are told when it is closed, not on standard error each time.

    Messages come behind its content, which may be left out later.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, mode="a", encoding="utf-8")
        self.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
        self._path, self._former = path, path.stat().st_size

    def begin(self) -> None:
        """Leave out what was there when it was opened."""
        self.flush()
        own = self._path.read_bytes()[self._former :]
        self._path.write_bytes(own)
        self._former = 0

    def handleError(self, record: logging.LogRecord) -> None:
        """See `logging.Handler`."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handleError(record)


class RunFiles:
    """Tables, fields and log of a run; used on rank 0 only."""

    def __init__(
        self, folder: Path, kinds: Sequence[str], bodies: Mapping[str, Body | Cloud]
    ) -> None:
        """Make and lock the folder, and hear messages; files of a former run are as they were.

        Kinds are those of files of fields, of the meshes of `bodies` by name.
        """
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._kinds, self._bodies = folder, kinds, bodies
        self._ends: Mapping[str, Any] = {}
        self._tables: dict[str, CsvFile] = {}
        self._fields: dict[str, list[Series | HdfSeries]] = {}
        self._ended: dict[str, Any] | None = None
        with ExitStack() as self._open:
            self.rows("history")
            self._log = LogFile(folder / "log.txt")
            self._open.enter_context(hearing(self._log))
            for name in bodies if "pvd" in kinds else ():
                (folder / name).mkdir(exist_ok=True)
            text, known = VIEW.read_text(encoding="utf-8"), repr(str(folder.resolve()))
            view = text.replace('FIELDS = ""', f"FIELDS = {known}", 1)
            (folder / "view.py").write_text(view, encoding="utf-8")
            self._open = self._open.pop_all()

    @property
    def former(self) -> bool:
        """Whether there are rows of a former run."""
        return self._tables["history"].former

    def series(self, name: str) -> Sequence[Series | HdfSeries]:
        """Files of the fields of a mesh, "fields", "points" or "joints"; none before they begin."""
        return self._fields.get(name, ())

    def begin(self, ends: Mapping[str, Any]) -> None:
        """Begin in the place of a former run's files, or go on from their `ends`."""
        self._ends = ends
        self.rows("history").begin(ends.get("history"))
        if not ends:
            self._log.begin()
        for name in LATER:
            if name in ends:
                self.rows(name).begin(ends[name])
            else:
                (self._folder / f"{name}.csv").unlink(missing_ok=True)
        for name, body in self._bodies.items():
            self._fields[name] = self._made(name, body)

    def _made(self, name: str, body: Body | Cloud) -> list[Series | HdfSeries]:
        known = self._ends.get(name, {})
        for kind in KINDS.keys() - known.keys():
            (self._folder / f"{name}.{kind}").unlink(missing_ok=True)
        made = []
        for kind in self._kinds:
            path = self._folder / f"{name}.{kind}"
            made.append(KINDS[kind](path, body, known.get(kind, (0, 0))))
            self._open.callback(made[-1].close)
        return made

    def rows(self, name: str) -> CsvFile:
        """A table by its name, which is opened when it is first asked for."""
        if name not in self._tables:
            table = CsvFile(self._folder / f"{name}.csv", LATER.get(name, ()))
            self._tables[name] = self._open.enter_context(closing(table))
        return self._tables[name]

    def ends(self) -> dict[str, Any]:
        """Where each file ends, once the disk has it; of closed files, where they ended."""
        if self._ended is not None:
            return self._ended
        found: dict[str, Any] = {name: table.kept() for name, table in self._tables.items()}
        for name, made in self._fields.items():
            found[name] = {k: s.kept() for k, s in zip(self._kinds, made, strict=True)}
        return found

    def close(self) -> None:
        """Close them; an `OSError` tells that the file system has not kept all data."""
        try:
            self._ended = self.ends()
        finally:
            self._ended = self._ended or {}
            self._open.close()


def kinds_of(format: str) -> tuple[str, ...]:
    """The kinds of files of a recorder, by a user's word; without h5py some are refused."""
    every = {kind: (kind,) for kind in KINDS} | {"both": tuple(KINDS)}
    if not isinstance(format, str) or format not in every:
        choice = ", ".join(f"'{kind}'" for kind in every)
        raise SceneError(f"Recorder: format must be one of {choice}, got {shown(format)}.")
    if "vtkhdf" in every[format]:
        hdf("Recorder")
    return every[format]
