"""A CSV file that grows by whole rows while a run goes on.

Rows are on the disk as soon as they are added, by one call of the system and wholly or not at all:
the file can be read while it grows, after a kill, and where the disk was full.

One process at a time writes it. The lock is the system's: it ends with the process, however that
ends.
"""

from __future__ import annotations

import csv
import fcntl
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from errno import EIO, ENOENT, ENOSPC
from pathlib import Path
from typing import Any

__all__ = ["CsvFile"]


class CsvFile:
    """A CSV file that takes the place of a former one, or goes on; used on rank 0 only."""

    def __init__(self, path: Path, columns: Sequence[str], end: int = 0) -> None:
        """Lock the file, empty it and write its header; or cut it off at an end.

        Args:
            path: The file.
            columns: Names of the columns.
            end: Length up to which its rows stay [bytes]; 0 for none.

        Raises:
            BlockingIOError: If it is open here already, or in another process.
            OSError: If it cannot be written, or has not so many bytes.
        """
        self._columns, self._path, self._end = columns, path, 0
        self._file = open(path, "ab", buffering=0)  # noqa: SIM115 - it stays open
        try:
            _lock(self._file.fileno())
            if end > os.fstat(self._file.fileno()).st_size:
                raise OSError(EIO, "rows that were there are gone", str(path))
            self._file.truncate(end)
            self._end = end
            self._named = bool(os.fstat(self._file.fileno()).st_nlink)  # some systems count none
            if not end:
                self._append(dict(zip(columns, columns, strict=True)))
        except OSError:
            self._file.close()
            raise

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
        text = io.StringIO(newline="")
        csv.DictWriter(text, self._columns).writerows(rows)
        data = text.getvalue().encode()
        try:
            if self._file.write(data) < len(data):
                raise OSError(ENOSPC, "No space left on device", str(self._path))
        except OSError as error:
            self._file.truncate(self._end)
            raise OSError(error.errno, error.strerror, str(self._path)) from error
        self._end += len(data)

    def kept(self) -> int:
        """Its length, once the disk has it [bytes]."""
        os.fsync(self._file.fileno())
        return self._end

    def close(self) -> None:
        """Close the file, which ends its lock.

        Raises:
            OSError: If the file system has not been able to keep all data.
        """
        self._file.close()


def _lock(file: int) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # a file system without locks: better no lock than no run
        pass
