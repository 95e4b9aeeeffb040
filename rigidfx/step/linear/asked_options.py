"""Has PETSc looked at an option? One that nobody asks for has no effect, and is misspelt at worst.

PETSc marks each option that is looked up. petsc4py 3.22 does not pass the marks on, so PETSc's
library, which it has loaded, is asked.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from functools import cache

from petsc4py import PETSc

__all__ = ["asked"]


def asked(names: Iterable[str]) -> set[str]:
    """Those options that have been looked up since they were set; all where PETSc cannot tell.

    Args:
        names: Names with their prefix, without '-'.
    """
    used, every = _options_used(), set(names)
    return every if used is None else {name for name in every if _is_marked(used, name)}


@cache
def _options_used() -> ctypes._NamedFuncPointer | None:
    """PETSc's function that tells; None if there is none."""
    try:
        return ctypes.CDLL(PETSc.__file__).PetscOptionsUsed
    except (AttributeError, OSError):
        return None


def _is_marked(used: ctypes._NamedFuncPointer, name: str) -> bool:
    answer = ctypes.c_int(0)  # room for an enumeration, and for the one byte of newer PETSc's
    failed = used(None, name.encode(), ctypes.byref(answer))
    return bool(failed or answer.value)
