"""Files of checkpoints: written whole or not at all, and read if they are whole.

    checkpoint-000012.rfx     a line of JSON, and what is kept, with a hash of it in the line

A file is put in its place once the disk has it; then the oldest of three is removed, all on rank 0.
The folder is made when a run begins, and never again: the place of a disk that is gone is empty.
One run at a time has a folder, by a lock that ends with its process; in a process it is the last
one. A new run sets checkpoints of a former one aside, as former-000012.rfx, until it has its own.
"""

import hashlib
import io
import json
import os
import pickle
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any
from weakref import WeakValueDictionary, finalize

from rigidfx.base.compat import package_version
from rigidfx.base.errors import OutputError, SceneError
from rigidfx.base.files import lock

FORMAT = 10  # of the files
KEPT = 2
NUMPY = {
    "_reconstruct": ("numpy._core.multiarray", "numpy.core.multiarray"),
    "scalar": ("numpy._core.multiarray", "numpy.core.multiarray"),
    "_frombuffer": ("numpy._core.numeric", "numpy.core.numeric"),
    "ndarray": ("numpy",),
    "dtype": ("numpy",),
}
PYTHON = {"deque": "collections"} | dict.fromkeys(("dict", "set", "frozenset"), "builtins")


class _Reader(pickle.Unpickler):
    """Makes arrays and records of this package, and nothing else that a file may name."""

    def find_class(self, module: str, name: str) -> Any:
        """The class of a name."""
        known = module in NUMPY.get(name, ()) or PYTHON.get(name) == module
        found = super().find_class(module, name) if known or _ours(module) else None
        own = isinstance(found, type) and _ours(found.__module__)  # a dotted name leads elsewhere
        if found is None or not (known or own):
            raise pickle.UnpicklingError(f"{module}.{name} is nothing that a checkpoint holds")
        return found


class _Writer(pickle.Pickler):
    """Writes mappings that nothing changes as such."""

    def reducer_override(self, value: Any) -> Any:
        """How to make a value."""
        return (dict, (dict(value),)) if isinstance(value, MappingProxyType) else NotImplemented


def _bytes_of(value: Any) -> bytes:
    out = io.BytesIO()
    _Writer(out, protocol=5).dump(value)
    return out.getvalue()


def _ours(module: str) -> bool:
    return module.split(".")[0] == "rigidfx"


def dumped(value: Any) -> bytes | None:
    """A value as bytes; None if it is none that `loaded` gives back, as a function is."""
    try:
        data = _bytes_of(value)
        loaded(data)
    except Exception:  # whatever a foreign class may raise
        return None
    return data


def loaded(data: bytes) -> Any:
    """The value of bytes of `dumped`: numbers, arrays, and records of this package only."""
    return _Reader(io.BytesIO(data)).load()


def own_version() -> str:
    """The version of this package, with that of its files."""
    return f"{package_version()}, format {FORMAT}"


class Claim:
    """A run has a folder to itself; on rank 0."""

    def __init__(self, folder: Path, *, goes_on: bool) -> None:
        """Make the folder if it does not exist, and see that files can be made there.

        Without `goes_on` its checkpoints are another run's. `BlockingIOError` if a run has it.
        """
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        place = os.path.realpath(folder)
        if place in CLAIMS:
            CLAIMS[place].close()
        file = open(folder / "checkpoint.lock", "ab", buffering=0)  # noqa: SIM115 - it stays open
        self._end = finalize(self, file.close)
        try:
            lock(file.fileno())
            if not goes_on:
                _set_aside(folder)
        except OSError:
            self.close()
            raise
        CLAIMS[place] = self

    def check(self) -> None:
        """Raise `BlockingIOError` if another run of this process has it."""
        if not self._end.alive:
            raise BlockingIOError

    def close(self) -> None:
        """Let other runs have it."""
        self._end()


CLAIMS: WeakValueDictionary[str, Claim] = WeakValueDictionary()  # of this process, by folder


def _set_aside(folder: Path) -> None:
    """Rename all checkpoints, the newest last: until then it is the one to go on from."""
    found = sorted(_numbers(folder).items())
    names = {folder / f"former-{number:06d}.rfx": file for number, file in found}
    for aside, file in names.items():
        file.replace(aside)
    for older in folder.glob("former-*.rfx") if found else ():
        if older not in names:
            older.unlink(missing_ok=True)


def write(folder: Path, head: Mapping[str, Any], kept: Any) -> Path:
    """Write the next checkpoint of a folder, with a head that is read first; remove the oldest.

    Where an `OSError` is raised nothing has changed.
    """
    data = _bytes_of(kept)
    marks = {"rigidfx": own_version(), "hash": hashlib.sha256(data).hexdigest()}
    line = json.dumps({**head, **marks})
    before = _numbers(folder)
    file = folder / f"checkpoint-{max(before, default=0) + 1:06d}.rfx"
    part = file.with_suffix(".part")
    try:
        with part.open("wb") as out:
            out.write(line.encode() + b"\n")
            out.write(data)
            out.flush()
            os.fsync(out.fileno())
        part.replace(file)
    except OSError:
        part.unlink(missing_ok=True)
        raise
    _sync(folder)
    for number in sorted(before, reverse=True)[KEPT - 1 :]:
        before[number].unlink(missing_ok=True)
    for older in folder.glob("former-*.rfx"):
        older.unlink(missing_ok=True)
    return file


def newest(folder: Path) -> tuple[Mapping[str, Any], bytes, str]:
    """The newest checkpoint of a folder that is whole: its head, content, path.

    It raises a `SceneError` if there is none, or it is of another version, and an `OutputError` if
    the folder cannot be read.
    """
    damaged = []
    try:
        files = _numbers(folder)
        for number in sorted(files, reverse=True):
            line, _, data = files[number].read_bytes().partition(b"\n")
            head = _head(line)
            if head.get("rigidfx", own_version()) != own_version():
                raise SceneError(
                    f"resume: '{files[number]}' was written by rigidfx {head['rigidfx']}, this is "
                    f"{own_version()}. Resume with that version, or run anew."
                )
            if head.get("hash") == hashlib.sha256(data).hexdigest():
                return head, data, str(files[number])
            damaged.append(files[number].name)
    except OSError as error:
        raise OutputError(
            f"resume: cannot read the folder '{folder}' ({error.strerror or error})."
        ) from None
    what = f"only damaged ones ({', '.join(damaged)})" if damaged else "none"
    if not damaged and any(folder.glob("former-*.rfx")):
        what = "none of the run that began there last, only former-*.rfx of the one before"
    raise SceneError(
        f"resume: a checkpoint is expected in the folder '{folder}', and there is {what}. "
        "simulate(…, checkpoint=Checkpoint(folder)) leaves them."
    )


def _head(line: bytes) -> dict[str, Any]:
    try:
        head = json.loads(line)
    except ValueError:
        return {}
    return head if isinstance(head, dict) else {}


def _numbers(folder: Path) -> dict[int, Path]:
    """Files of checkpoints by number."""
    return dict(_listed(folder))


def _listed(folder: Path) -> Iterator[tuple[int, Path]]:
    for file in folder.glob("checkpoint-*.rfx"):
        number = file.stem.partition("-")[2]
        if number.isdecimal():
            yield int(number), file


def _sync(folder: Path) -> None:
    """Sync the folder to the disk."""
    try:
        number = os.open(folder, os.O_RDONLY)
    except OSError:  # a file system that opens no folders
        return
    try:
        os.fsync(number)
    except OSError:
        pass
    finally:
        os.close(number)
