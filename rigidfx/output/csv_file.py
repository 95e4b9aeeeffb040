"""A CSV file that grows by whole rows while a run goes on.

Rows are on the disk as soon as they are added, by one call of the system and wholly or not at all:
the file can be read while it grows, after a kill, and where the disk was full.

One process at a time writes it. The lock is the system's: it ends with the process, however that
ends.
"""

from __future__ import annotations

import csv
import io
import os
import zlib
from collections.abc import Iterable, Mapping, Sequence
from errno import ENOENT, ENOSPC
from pathlib import Path
from typing import Any

from rigidfx.base.file_lock import lock
from rigidfx.output.changed import ChangedFile

__all__ = ["CsvFile"]


class CsvFile:
    """A CSV file that takes the place of a former one, or goes on; used on rank 0 only.

    Attributes:
        former: Whether it has rows of a former run.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        """Lock the file; one without rows gets its header.

        Args:
            path: The file.
            columns: Names of the columns.

        Raises:
            BlockingIOError: If it is open here already, or in another process.
            OSError: If it cannot be written.
        """
        self._columns, self._path, self._end, self._sum = columns, path, 0, 0
        self._file = open(path, "a+b", buffering=0)  # noqa: SIM115 - it stays open
        try:
            lock(self._file.fileno())
            status = os.fstat(self._file.fileno())
            self._named = bool(status.st_nlink)  # some systems count none
            self.former = status.st_size > len(self._text(dict(zip(columns, columns, strict=True))))
            if not self.former:
                self.begin(None)
        except OSError:
            self._file.close()
            raise

    def begin(self, kept: tuple[int, int] | None) -> None:
        """Empty the file but for its header, or cut it off where it ended.

        Args:
            kept: Of `kept`, if rows stay.

        Raises:
            OSError: If it cannot be written, or has other rows.
        """
        end, known = kept or (0, 0)
        header = dict(zip(self._columns, self._columns, strict=True))
        self._file.seek(0)
        there = self._file.read(end)
        if zlib.crc32(there) != known:
            raise ChangedFile(self._path, "rows that were there are gone")
        if end and not there.startswith(self._text(header)):
            raise ChangedFile(self._path, "its columns are not those of the recorder's options")
        self._file.truncate(end)
        self._end, self._sum = end, known
        if not end:
            self._append(header)

    def add(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Add rows.

        Args:
            rows: Values by the names of their columns.

        Raises:
            OSError: If they cannot be written; the file is as before then. Or if it was removed.
        """
        if self._named and not os.fstat(self._file.fileno()).st_nlink:
            raise OSError(ENOENT, "removed since the run began", str(self._path))
        self._append(*rows)

    def _append(self, *rows: Mapping[str, Any]) -> None:
        if not rows:
            return
        data = self._text(*rows)
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
        """Close the file, which ends its lock.

        Raises:
            OSError: If the file system has not been able to keep all data.
        """
        self._file.close()
