"""A C library of ours, compiled once for all processes and kept beside FFCx's compiled forms.

It is compiled in a folder of its own and moved to its place when it is whole, so that no process
ever finds half of it, and none waits for another.

Where the C compiler has failed, or its result cannot be kept, messages have the remedy. cffi says
no more than "CompileError: command ... failed", on rank 0, and DOLFINx on the others that a form
has not been compiled; the compiler's own messages go to standard error.
"""

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
from shutil import which
from typing import Any

from cffi import FFI, VerificationError
from dolfinx import jit
from mpi4py import MPI

from rigidfx.base.errors import CompilerError, OutputError, agree

COMPILING = re.compile(r"(?:Compile|Link)Error: (.*)", re.DOTALL)


def compiles(comm: MPI.Intracomm) -> bool:
    """Whether the C compiler of rank 0 takes an empty file, without flags of ours. Collective."""
    able = False
    if comm.rank == 0:
        command = os.environ.get("CC") or str(sysconfig.get_config_var("CC"))
        empty = [*shlex.split(command), "-x", "c", "-fsyntax-only", os.devnull]
        with suppress(OSError, ValueError):
            able = subprocess.run(empty, capture_output=True, check=False).returncode == 0
    return comm.bcast(able)


def raise_uncompiled(comm: MPI.Intracomm, error: Exception | None, folder: str | Path) -> None:
    """Raise on all ranks the remedy for a compilation that has failed on any. Collective.

    On several ranks the error has the text of that of rank 0. It is an `OutputError` if the cache
    cannot be written to, and a `CompilerError` if the compiler cannot be run, or fails.
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
    command = shlex.split(given or str(sysconfig.get_config_var("CC")))[0]
    named = f", which the environment variable CC names: {given!r}," if given else ""
    compiler = f"The C compiler '{command}'{named} that makes kernels of forms"
    if which(command) is None:
        remedy = (
            "Correct or unset CC."
            if given
            else "Install it, with the headers of the C library (Debian: gcc, libc6-dev), or name "
            "another by the environment variable CC."
        )
        return f"{compiler} cannot be run (it was not found). {remedy}"
    return (
        f"{compiler} has failed: {said[1]}. What it says of that is on standard error. Among the "
        "causes are headers that are missing (Debian: libc6-dev, python3-dev), and too little "
        f"memory, or space in '{folder}' or in the folder for temporary files. Compiled forms are "
        "made anew once that folder is removed."
    )


def c_library(
    comm: MPI.Intracomm, name: str, source: str, declarations: str, flags: Sequence[str]
) -> Any:
    """The module of a C source, with its `lib` and `ffi`; rank 0 compiles. Collective.

    The declarations are the source's for Python, as cffi reads them. The library's name gets a
    digest of all else. Errors are those of `raise_uncompiled`.
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
