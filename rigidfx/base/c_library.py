"""A C library of ours, compiled once for all processes and kept beside FFCx's compiled forms.

It is compiled in a folder of its own and moved to its place when it is whole, so that no process
ever finds half of it, and none waits for another.

Where the C compiler has failed, or its result cannot be kept, messages have the remedy. cffi says
no more than "CompileError: command ... failed", on rank 0, and DOLFINx on the others that a form
has not been compiled; the compiler's own messages go to standard error.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import shlex
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from cffi import FFI, VerificationError
from dolfinx import jit
from mpi4py import MPI

from rigidfx.base.errors import CompilerError, OutputError, agree

COMPILING = re.compile(r"(?:Compile|Link)Error: (.*)", re.DOTALL)


def compiles(comm: MPI.Intracomm) -> bool:
    """Whether the C compiler takes an empty file, without any flags of ours. Collective.

    Args:
        comm: Its rank 0 compiles.
    """
    able = False
    if comm.rank == 0:
        command = os.environ.get("CC") or str(sysconfig.get_config_var("CC"))
        empty = [*shlex.split(command), "-x", "c", "-fsyntax-only", os.devnull]
        with suppress(OSError, ValueError):
            able = subprocess.run(empty, capture_output=True, check=False).returncode == 0
    return comm.bcast(able)


def raise_uncompiled(comm: MPI.Intracomm, error: Exception | None, folder: str | Path) -> None:
    """Raise, on all ranks, the remedy for a compilation that has failed. Collective.

    Args:
        comm: Ranks that have compiled.
        error: Its exception on this rank, if any; on several ranks a text with that of rank 0.
        folder: The cache of compiled forms.

    Raises:
        OutputError: On every rank, if the cache cannot be written to on any.
        CompilerError: On every rank, if the compiler cannot be run, or fails.
    """
    agree(comm, None if error is None else _unwritten(error, folder), OutputError)
    agree(comm, None if error is None else _uncompiled(error, folder), CompilerError)


def _unwritten(error: Exception, folder: str | Path) -> str | None:
    """The remedy where the cache cannot be written to, None if another cause has failed."""
    said = re.search(r"\[Errno \d+\] ([^:]*)", str(error))
    if said is None or COMPILING.search(str(error)):
        return None
    return (
        f"Nothing can be compiled into the folder '{folder}' ({said[1].strip()}). Check the space "
        "left there and whether you may write to it, or name another folder by the environment "
        "variable XDG_CACHE_HOME."
    )


def _uncompiled(error: Exception, folder: str | Path) -> str | None:
    """The remedy for the compiler, None if it has not failed."""
    said = COMPILING.search(str(error))
    if said is None:
        return None
    given = os.environ.get("CC", "")
    command, how, runs = _told(said[1])
    command = command or given or str(sysconfig.get_config_var("CC"))
    named = f", which the environment variable CC names: {given!r}," if given else ""
    what = f"The C compiler '{command}'{named} that makes kernels of forms"
    if not runs:
        remedy = (
            "Correct or unset CC."
            if given
            else "Install it, with the headers of the C library (Debian: gcc, libc6-dev), or name "
            "another by the environment variable CC."
        )
        return f"{what} cannot be run ({how or 'it was not found'}). {remedy}"
    return (
        f"{what} has failed {how}; what it says of that is on standard error. Among the causes "
        f"are headers that are missing (Debian: libc6-dev, python3-dev), and too little memory, or "
        f"space in '{folder}' or in the folder for temporary files. Compiled forms are made anew "
        "once that folder is removed."
    )


def _told(said: str) -> tuple[str, str, bool]:
    """The command, how it has failed, and whether it has run at all, as setuptools tells them."""
    found = re.match(r"command '([^']*)' failed:? ?(.*)", said)
    if found:
        return found[1], found[2], re.search("exit (code|status)|signal", found[2]) is not None
    # From version 80 or so on, in the words of Python's own errors.
    found = re.match(r"Command '\['([^']*)'.*\]' (?:returned non-zero (.*)|died (.*))\.", said)
    if found:
        return found[1], f"with {found[2]}" if found[2] else found[3], True
    found = re.match(r"\[Errno \d+\] ([^:]*)(?:: '([^']*)')?", said)
    return (found[2] or "", found[1], False) if found else ("", said, False)


def c_library(
    comm: MPI.Intracomm, name: str, source: str, declarations: str, flags: Sequence[str]
) -> Any:
    """The module of a C source, with its `lib` and `ffi`. Collective.

    Args:
        comm: Its rank 0 compiles.
        name: Name of the library; a digest of the rest is added.
        source: C source.
        declarations: Its declarations for Python, as cffi reads them.
        flags: The compiler's.

    Raises:
        OutputError: On every rank, if the cache cannot be written to.
        CompilerError: On every rank, if the C compiler cannot be run, or fails.
    """
    told = "\0".join([source, declarations, *flags, sys.version])
    name = f"rigidfx_{name}_{hashlib.sha1(told.encode()).hexdigest()}"
    folder = Path(jit.get_options(None)["cache_dir"])
    failed: Exception | None = None
    path: Path | None = None
    if comm.rank == 0:
        try:
            path = _found(folder, name) or _compiled(folder, name, source, declarations, flags)
        except (VerificationError, OSError) as error:
            failed = error
    raise_uncompiled(comm, failed, folder)
    path, problem = comm.bcast((path, str(failed)))
    if path is None:
        raise CompilerError(problem) from failed
    if name not in sys.modules:
        spec: Any = importlib.util.spec_from_file_location(name, path)
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def _found(folder: Path, name: str) -> Path | None:
    path = folder / f"{name}{sysconfig.get_config_var('EXT_SUFFIX')}"  # ffi.compile's
    return path if path.exists() else None


def _compiled(
    folder: Path, name: str, source: str, declarations: str, flags: Sequence[str]
) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    ffi = FFI()
    ffi.cdef(declarations)
    ffi.set_source(name, source, extra_compile_args=list(flags))
    with tempfile.TemporaryDirectory(dir=folder) as own:
        made = Path(ffi.compile(tmpdir=own))
        path = folder / made.name
        os.replace(made, path)
    return path
