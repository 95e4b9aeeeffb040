"""Exceptions of Python functions that PETSc calls, in place of PETSc's error about it.

Python raises a Ctrl-C mostly in a function that SNES has called. PETSc replaces any exception of
such a function by an error of its own (number -1), with the exception as its cause.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from petsc4py import PETSc

__all__ = ["errors_of_callbacks"]


@contextmanager
def errors_of_callbacks() -> Iterator[None]:
    """Around a call of PETSc that calls back.

    Raises:
        BaseException: The exception of a function called by PETSc.
    """
    try:
        yield
    except PETSc.Error as error:
        cause = error.__cause__ or error.__context__
        if cause is None:
            raise
        raise cause from None
