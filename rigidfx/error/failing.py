"""What happens where the linear algebra of e fails: e is dropped, and the run goes on without it.

The motion u needs no e. Without e nothing tells which rigid cells strain, so that all bodies are
released before the next step. Parts that qualify later freeze again, with an e that begins anew.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, Protocol, TypeVar

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.types import Array

__all__ = ["finite", "or_dropped"]

T = TypeVar("T")


class _Dropped(Protocol):
    """Something that can begin anew: see `ErrorMotion`."""

    def drop(self, error: Exception) -> None:
        """Begin anew after a failure. Collective."""
        ...


def or_dropped(method: Callable[..., T]) -> Callable[..., T]:
    """A method whose failures drop e; it is called once more then, where e is zero. Collective."""

    @wraps(method)
    def guarded(owner: _Dropped, *given: Any, **named: Any) -> T:
        try:
            return method(owner, *given, **named)
        except (np.linalg.LinAlgError, PETSc.Error) as error:
            owner.drop(error)
            return method(owner, *given, **named)

    return guarded


def finite(values: Array, comm: MPI.Intracomm) -> Array:
    """Values of e, if they are finite on all ranks. Collective.

    Raises:
        LinAlgError: On every rank, if they are not.
    """
    if comm.allreduce(bool(np.isfinite(values).all()), op=MPI.LAND):
        return values
    raise np.linalg.LinAlgError("numbers are not finite")
