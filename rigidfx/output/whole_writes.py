"""A binary file whose changes reach the disk together: it can be opened after a kill at any time.

Libraries write a file here and there, in an order of their own. Here bytes are kept in memory until
`commit`. It writes new ones behind the file's end first, where no reader looks yet. Of those that
replace old ones it writes those at the file's beginning first, where formats say how long it is,
then all others from the end on: tables of contents are written after their entries.
"""

import io
import os
import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from errno import EIO, ENOSPC
from pathlib import Path
from typing import Any


class ChangedFile(OSError):
    """A file lacks content that a checkpoint tells of, or has another one."""

    def __init__(self, path: Path, why: str) -> None:
        """Name the file, and its change as the end of a sentence."""
        super().__init__(EIO, why, str(path))


class WholeWrites(io.RawIOBase):
    """A new file in the place of a former one; used on rank 0 only."""

    def __init__(self, path: Path) -> None:
        """Make the file, empty."""
        path.unlink(missing_ok=True)  # readers of a former one keep it
        self._path = path
        self._open = open(path, "x+b", buffering=0)  # noqa: SIM115 - it stays open
        self._file = self._open.fileno()
        self._size = 0  # up to where readers look
        self._end = 0  # up to where there are bytes
        self._changed: dict[int, bytes] = {}  # since the last commit, by place
        self._at = 0

    def commit(self) -> None:
        """Bring all changes to the disk; without space, readers see the file as before."""
        new = [place for place in self._changed if place >= self._size]
        for place in new:
            self._put(place, self._changed[place])
        old = {place: data for place, data in self._changed.items() if place < self._size}
        if 0 in old:
            self._put(0, old.pop(0))
        for place, data in self._joined(old):
            self._put(place, data)
        self._size = self._end
        self._changed.clear()

    def _put(self, place: int, data: Any) -> None:
        view = memoryview(data).cast("B")
        while view:
            done = os.pwrite(self._file, view, place)
            if not done:
                raise OSError(ENOSPC, "No space left on device", str(self._path))
            view, place = view[done:], place + done

    def _joined(self, changed: Mapping[int, bytes]) -> Iterator[tuple[int, bytes]]:
        """Changes from the file's end on, near ones with the bytes between."""
        runs: list[list[int]] = []  # places of near changes
        end = -1
        for place in sorted(changed):
            if not runs or place - end > io.DEFAULT_BUFFER_SIZE:
                runs.append([])
            runs[-1].append(place)
            end = max(end, place + len(changed[place]))
        for places in reversed(runs):
            end = max(place + len(changed[place]) for place in places)
            yield places[0], self._look(places[0], end - places[0])

    def _look(self, place: int, count: int) -> bytes:
        """Bytes as they will be, fewer at the end of the file."""
        count = max(min(count, self._end - place), 0)
        out = bytearray(os.pread(self._file, count, place).ljust(count, b"\0"))
        for first, data in self._changed.items():  # in the order of writing
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
        here = max(min(self._size - place, count), 0)  # bytes where readers look
        for first, part in ((place, data[:here]), (place + here, data[here:])):
            if part:
                before = self._changed.pop(first, b"")
                self._changed[first] = bytes(part) + before[len(part) :]
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
