"""Small text files, written by rank 0; letters of files that others have written; locks."""

import codecs
import fcntl
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

from rigidfx.base.errors import SceneError, on_rank_0


def lock(file: int, how: int = fcntl.LOCK_EX | fcntl.LOCK_NB) -> None:
    """Lock an open file until it is closed; raise `BlockingIOError` if it is locked already.

    One process at a time has the lock, which ends with the process.
    """
    try:
        fcntl.flock(file, how)
    except BlockingIOError:
        raise
    except OSError:  # a file system without locks: better no lock than no run
        pass


def decoded(data: bytes) -> str:
    """Letters of a text: UTF-8, else cp1252, else Latin-1, so that no two texts become one."""
    for encoding in ("utf-8-sig", "cp1252"):
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    return data.decode("latin-1")


@dataclass
class Decoder:
    """Letters of files of an encoding that may be known."""

    encoding: str | None = None  # Python's name of the encoding; as `decoded` finds it if None
    guessed: bool = False  # whether a file was not in UTF-8 although no encoding was given

    def read(self, path: Path) -> str:
        """The text of a file; raise `SceneError` if it is no text of the encoding."""
        data = path.read_bytes()
        if self.encoding is None:
            if b"\0" in data:
                raise SceneError(
                    f"'{path}' has bytes that are zero: it is no text file, or one of which the "
                    "encoding must be given, such as encoding='utf-16'."
                )
            text = decoded(data)
            self.guessed |= text.encode() != data.removeprefix(codecs.BOM_UTF8)
            return text
        try:
            return data.decode(self.encoding)
        except (LookupError, UnicodeError) as error:
            raise SceneError(f"'{path}': encoding={self.encoding!r}: {error}.") from None


def write_text(comm: MPI.Intracomm, path: str | Path, text: str) -> None:
    """Write a file, whole or not at all, and its folder if need be, on rank 0. Collective.

    It raises an `OutputError` on every rank, if the file cannot be written.
    """
    path = Path(path)

    def write() -> None:
        part = path.with_name(f"{path.name}.part")
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(text, encoding="utf-8")
        part.replace(path)

    def problem(error: Exception) -> str:
        if isinstance(error, OSError):
            return f"'{path}' cannot be written: {error.strerror or error}."
        return f"{str(path)!a} can be the name of no file: {error}."

    on_rank_0(comm, write, problem)
