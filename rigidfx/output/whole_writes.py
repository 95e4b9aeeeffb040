"""A binary file whose changes reach the disk together: it can be opened after a kill at any time.

Libraries write a file here and there, in an order of their own. Here new bytes go behind the file's
end at once, where no reader looks yet. Bytes that replace old ones are kept in memory until
`commit`. It writes those at the file's beginning first, where formats say how long it is, then all
others from the end on: tables of contents that come before their entries are written after them.
"""

from __future__ import annotations

import io
import os
from errno import EIO, ENOSPC
from pathlib import Path
from typing import Any


class ChangedFile(OSError):
    """A file lacks content that a checkpoint tells of, or has another one."""

    def __init__(self, path: Path, why: str) -> None:
        """Name the file.

        Args:
            path: The file.
            why: What has changed, as the end of a sentence.
        """
        super().__init__(EIO, why, str(path))


class WholeWrites(io.RawIOBase):
    """A new file in the place of a former one; used on rank 0 only."""

    def __init__(self, path: Path) -> None:
        """Make the file, empty.

        Raises:
            OSError: If it cannot be made.
        """
        path.unlink(missing_ok=True)  # readers of a former one keep it
        self._path = path
        self._open = open(path, "x+b", buffering=0)  # noqa: SIM115 - it stays open
        self._file = self._open.fileno()
        self._size = 0  # up to where readers look
        self._end = 0  # up to where there are bytes
        self._changed: dict[int, bytes] = {}  # replaces bytes that readers see, by place
        self._late: dict[int, bytes] = {}  # could not be written behind these
        self._at = 0

    def commit(self) -> None:
        """Bring all changes to the disk.

        Raises:
            OSError: If there is no space; readers see the file as before then.
        """
        for place in [*self._late]:
            self._put(place, self._late[place])
            del self._late[place]
        if 0 in self._changed:
            self._put(0, self._changed.pop(0))
        for place, data in self._joined():
            self._put(place, data)
        self._size = self._end
        self._changed.clear()

    def put(self, place: int, data: Any) -> None:
        """Write bytes of a library's where readers may look, but of which nothing tells yet.

        Args:
            place: Of the first one, in space that the library has written.
            data: The bytes.
        """
        try:
            if self._late:
                raise OSError
            self._put(place, data)
        except OSError:
            self._late[place] = bytes(data)

    def _put(self, place: int, data: Any) -> None:
        view = memoryview(data).cast("B")
        while view:
            done = os.pwrite(self._file, view, place)
            if not done:
                raise OSError(ENOSPC, "No space left on device", str(self._path))
            view, place = view[done:], place + done

    def _joined(self) -> list[tuple[int, bytes]]:
        """Changes from the file's end on, near ones with the bytes between."""
        runs: list[tuple[int, int, list[int]]] = []  # places of bytes, and of the changes there
        first, last, members = -1, -1, list[int]()
        for place in sorted(self._changed):
            end = place + len(self._changed[place])
            if not members or place - last > io.DEFAULT_BUFFER_SIZE:
                first, last, members = place, end, []
                runs.append((first, last, members))
            members.append(place)
            last = max(last, end)
            runs[-1] = first, last, members
        order = {place: k for k, place in enumerate(self._changed)}
        found = []
        for first, end, members in reversed(runs):
            if len(members) == 1:
                found.append((first, self._changed[first]))
                continue
            out = bytearray(os.pread(self._file, end - first, first))
            for place in sorted(members, key=order.__getitem__):
                data = self._changed[place]
                out[place - first : place - first + len(data)] = data
            found.append((first, bytes(out)))
        return found

    def _look(self, place: int, count: int) -> bytes:
        """Bytes as they will be, fewer at the end of the file."""
        count = max(min(count, self._end - place), 0)
        out = bytearray(os.pread(self._file, count, place).ljust(count, b"\0"))
        for changes in (self._late, self._changed):
            for first, data in changes.items():  # in the order of writing
                low, high = max(first, place), min(first + len(data), place + count)
                if low < high:
                    out[low - place : high - place] = data[low - first : high - first]
        return bytes(out)

    # Called by a library ------------------------------------------------------------------------

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """See `io.RawIOBase`."""
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._end}[whence]
        self._at = offset + start
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
        data, place = memoryview(buffer).cast("B"), self._at
        count = len(data)
        self._at = place + count
        if place < self._size:  # readers look there
            here = bytes(data[: self._size - place])
            before = self._changed.pop(place, b"")
            self._changed[place] = here + before[len(here) :]
            data, place = data[len(here) :], place + len(here)
        if data:
            try:
                self._put(place, data)
            except OSError:  # a library must not be left in the middle: it comes out at the commit
                self._late[place] = bytes(data)
            self._end = max(self._end, self._at)
        return count

    def truncate(self, size: int | None = None) -> int:
        """See `io.RawIOBase`: it gets longer only; bytes that are not used stay at its end."""
        size = self._at if size is None else size
        if size > self._end:
            self._at, kept = size - 1, self._at
            self.write(b"\0")
            self._at = kept
        return size

    def close(self) -> None:
        """Close the file without changes that have not been committed."""
        if not self.closed:
            self._open.close()
        super().close()
