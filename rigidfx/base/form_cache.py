"""Compiled forms in FFCx's cache, which processes share: one compiles, others wait, none for ever.

FFCx takes a source file without a result for another process's work in progress, waits for a set
time and gives up: too early where another process compiles a large form, and in vain where one was
interrupted. So who may be compiling holds a shared lock, which the system takes back when a process
ends. A source is left over if nobody holds the lock.
"""

from __future__ import annotations

import fcntl
import logging
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import ufl
from dolfinx import fem, jit
from mpi4py import MPI

__all__ = ["PATIENCE", "compile_form", "wait_or_clear"]

LOCK = "rigidfx.lock"  # beside the compiled forms
# Options for small forms, which are compiled within seconds: 10 s are few on a busy machine.
PATIENCE = {"timeout": 60}


def compile_form(comm: MPI.Intracomm, form: ufl.Form, options: dict[str, Any]) -> Any:
    """Compile a form, or wait for another process that does. Collective.

    Args:
        comm: Its rank 0 compiles.
        form: UFL form.
        options: Options for FFCx's compiler; after their timeout, others are asked about.
    """
    while True:
        with _may_compile(comm, options):
            try:
                return fem.compile_form(comm, form, jit_options=options)
            except (RuntimeError, TimeoutError) as error:
                waited = re.search(r"remove (\S+\.c)\)", str(error))
                source = comm.bcast(waited[1] if waited else None)
                if source is None:
                    raise
        if comm.rank == 0:
            wait_or_clear(Path(source))
        comm.barrier()


@contextmanager
def _may_compile(comm: MPI.Intracomm, options: dict[str, Any]) -> Iterator[None]:
    """Hold the shared lock on rank 0."""
    if comm.rank:
        yield
        return
    folder = Path(jit.get_options(options)["cache_dir"])
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / LOCK).open("w") as file:
        _locks(file, fcntl.LOCK_SH)
        yield


def wait_or_clear(source: Path) -> None:
    """Wait until a form is compiled; if nobody compiles, remove what is in the way.

    Args:
        source: The C file without a result.
    """
    said = False
    while source.exists() and not source.with_suffix(".c.cached").exists():
        with (source.parent / LOCK).open("w") as file:
            if _locks(file, fcntl.LOCK_EX | fcntl.LOCK_NB):
                source.unlink(missing_ok=True)
                return
        if not said:
            logging.getLogger(__name__).warning(
                "waiting for another process, which compiles %s", source
            )
            said = True
        time.sleep(0.5)


def _locks(file: Any, how: int) -> bool:
    """Whether a lock could be had; it is taken for had where the file system knows no locks."""
    try:
        fcntl.flock(file, how)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True
