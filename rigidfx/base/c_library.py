"""A C library of ours, compiled once for all processes and kept beside FFCx's compiled forms.

It is compiled in a folder of its own and moved to its place when it is whole, so that no process
ever finds half of it, and none waits for another.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cffi import FFI, VerificationError
from dolfinx import jit
from mpi4py import MPI

from rigidfx.base.compiler import raise_uncompiled
from rigidfx.base.errors import CompilerError

__all__ = ["c_library"]


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
