"""Small text files, written by rank 0."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from rigidfx.base.errors import OutputError, agree

__all__ = ["write_text"]


def write_text(comm: MPI.Intracomm, path: str | Path, text: str) -> None:
    """Write a file, whole or not at all, and its folder if need be. Collective; rank 0 writes.

    Args:
        comm: Communicator of the calling ranks.
        path: File.
        text: Its content.

    Raises:
        OutputError: On every rank, if it cannot be written.
    """
    problem = None
    if comm.rank == 0:
        path = Path(path)
        part = path.with_name(f"{path.name}.part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            part.write_text(text, encoding="utf-8")
            part.replace(path)
        except OSError as error:
            problem = f"'{path}' cannot be written: {error.strerror or error}."
        except UnicodeError as error:
            problem = f"{str(path)!a} can be the name of no file: {error}."
    agree(comm, problem, OutputError)
