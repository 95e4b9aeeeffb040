"""Messages of a run, through Python's logging, by the logger "rigidfx" on rank 0.

It names compiled forms, the size of the run, switches, and how it ended, at the level INFO. Whoever
wants to hear it gives that logger a handler, or has a run (`verbose`); a recorder keeps it in a
file.
"""

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mpi4py import MPI

LOGGER = logging.getLogger("rigidfx")
SHOWN = "rigidfx: "  # begins each line on standard error
FIRST = 25  # level, above INFO, of what is said outside a terminal, too: why one waits

_runs: list[MPI.Intracomm] = []  # under way, by their ranks


def announce(text: str) -> None:
    """Say on this rank why a first run waits, also before and without a run, if not silent."""
    LOGGER.log(FIRST, text)
    if not _runs:  # a scene is described, say, or its modes are sought
        sys.stderr.write(f"{SHOWN}{text}\n")
        sys.stderr.flush()


def tell(comm: MPI.Intracomm, text: str) -> None:
    """Say something on rank 0 that all ranks know."""
    if comm.rank == 0:
        LOGGER.info(text)


def remind(comm: MPI.Intracomm, text: str) -> None:
    """Say on rank 0 how far a long run is, unless it is silent."""
    if comm.rank == 0:
        LOGGER.log(FIRST, text)


@contextmanager
def heard(comm: MPI.Intracomm, verbose: bool | None) -> Iterator[None]:
    """Show messages on standard error, on rank 0, meanwhile.

    If `verbose` is None all are shown where that is a terminal; elsewhere compilations, and once a
    minute how far the run is.
    """
    level = logging.INFO if verbose or sys.stderr.isatty() else FIRST
    if verbose is False or comm.rank > 0:
        with _under_way(comm):
            yield
        return
    from tqdm import tqdm

    class Beside(logging.Handler):
        """Writes above a progress bar."""

        def emit(self, record: logging.LogRecord) -> None:
            tqdm.write(f"{SHOWN}{record.getMessage()}", file=sys.stderr)

    with hearing(Beside(level), level), _under_way(comm):
        yield


@contextmanager
def _under_way(comm: MPI.Intracomm) -> Iterator[None]:
    """Remember that a run is under way."""
    _runs.append(comm)
    try:
        yield
    finally:
        _runs.remove(comm)


def folders() -> list[Path]:
    """Folders of the files that hear messages now: where results go."""
    return [Path(os.path.relpath(file.baseFilename)).parent for file in _files()]


def keep(text: str) -> None:
    """Write a warning to the files that hear messages now; nothing is shown."""
    told = LOGGER.makeRecord(LOGGER.name, logging.WARNING, "", 0, text, (), None)
    for file in _files():
        file.handle(told)


def _files() -> list[logging.FileHandler]:
    return [handler for handler in LOGGER.handlers if isinstance(handler, logging.FileHandler)]


@contextmanager
def hearing(handler: Any, least: int = logging.INFO) -> Iterator[None]:
    """Let a handler hear messages from a level on meanwhile; it is closed at the end."""
    level = LOGGER.level
    LOGGER.addHandler(handler)
    LOGGER.setLevel(min(level, least) if level else least)
    try:
        yield
    finally:
        LOGGER.removeHandler(handler)
        LOGGER.setLevel(level)
        handler.close()
