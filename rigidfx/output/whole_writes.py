"""A binary file whose changes reach the disk together: it can be opened after a kill at any time.

Libraries write a file here and there, in an order of their own. Here all of it is kept in memory
until `commit`, which appends new bytes first, where no reader looks yet, and then replaces old ones
from the file's beginning on, by few calls of the system.
"""

from __future__ import annotations

import io
import os
from errno import ENOSPC
from pathlib import Path
from typing import Any

__all__ = ["WholeWrites"]


class WholeWrites(io.RawIOBase):
    """A new file in the place of a former one; used on rank 0 only."""

    def __init__(self, path: Path) -> None:
        """Make the file, empty.

        Args:
            path: The file.

        Raises:
            OSError: If it cannot be made.
        """
        path.unlink(missing_ok=True)  # whoever reads a former one keeps it
        self._path = path
        self._open = open(path, "x+b", buffering=0)  # noqa: SIM115 - it stays open
        self._file = self._open.fileno()
        self._size = 0  # on the disk
        self._added = bytearray()  # what comes behind it
        self._changed: dict[int, bytes] = {}  # what replaces bytes there, by their places
        self._at = 0

    def commit(self) -> None:
        """Bring all changes to the disk.

        Raises:
            OSError: If there is no space; the file is as before then.
        """
        try:
            if self._added:
                self._put(self._size, bytes(self._added))
        except OSError:
            os.ftruncate(self._file, self._size)
            raise
        for place, data in self._joined():
            self._put(place, data)
        self._size += len(self._added)
        self._added.clear()
        self._changed.clear()

    def _put(self, place: int, data: bytes) -> None:
        view = memoryview(data)
        while view:
            done = os.pwrite(self._file, view, place)
            if not done:
                raise OSError(ENOSPC, "No space left on device", str(self._path))
            view, place = view[done:], place + done

    def _joined(self) -> list[tuple[int, bytes]]:
        """Changes from the file's beginning on, near ones with what lies between them."""
        runs: list[list[int]] = []
        for place in sorted(self._changed):
            end = place + len(self._changed[place])
            if runs and place - runs[-1][1] <= io.DEFAULT_BUFFER_SIZE:
                runs[-1][1] = max(runs[-1][1], end)
            else:
                runs.append([place, end])
        return [(first, self._look(first, end - first)) for first, end in runs]

    def _look(self, place: int, count: int) -> bytes:
        """Bytes as they will be, fewer at the end of the file."""
        here = max(min(count, self._size - place), 0)
        out = bytearray(os.pread(self._file, here, place)) if here else bytearray()
        for first, data in self._changed.items():  # in the order of writing
            low, high = max(first, place), min(first + len(data), place + here)
            if low < high:
                out[low - place : high - place] = data[low - first : high - first]
        start = max(place - self._size, 0)
        out += self._added[start : start + count - here]
        return bytes(out)

    # What a library calls -----------------------------------------------------------------------

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """See `io.RawIOBase`."""
        end = self._size + len(self._added)
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: end}[whence]
        return self._at

    def tell(self) -> int:
        """See `io.RawIOBase`."""
        return self._at

    def readable(self) -> bool:
        """It is."""
        return True

    def writable(self) -> bool:
        """It is."""
        return True

    def seekable(self) -> bool:
        """It is."""
        return True

    def readinto(self, buffer: Any) -> int:
        """See `io.RawIOBase`."""
        data = self._look(self._at, len(buffer))
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)

    def write(self, buffer: Any) -> int:
        """See `io.RawIOBase`."""
        data = bytes(buffer)
        here = data[: max(self._size - self._at, 0)]
        if here:
            before = self._changed.pop(self._at, b"")
            self._changed[self._at] = here + before[len(here) :]
        start, rest = max(self._at - self._size, 0), data[len(here) :]
        if rest:
            self._added += bytes(max(start - len(self._added), 0))
            self._added[start : start + len(rest)] = rest
        self._at += len(data)
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        """See `io.RawIOBase`: it gets longer only; bytes that are not used stay at its end."""
        size = self._at if size is None else size
        self._added += bytes(max(size - self._size - len(self._added), 0))
        return size

    def close(self) -> None:
        """Close the file without what has not been committed."""
        if not self.closed:
            self._open.close()
        super().close()
