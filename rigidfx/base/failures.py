"""Exceptions of a user's own code in the middle of a step, raised on all ranks together.

Effects, obstacles and criteria of a user's own are asked on each rank about that rank's nodes and
cells. One of them may fail on a single rank, while others are on their way to a collective call and
would wait there for ever. So its exceptions are kept, something neutral goes on in its place, and
ranks look whether anything has been kept where they exchange numbers or change course in any case:
in the sums over a state, and after an attempt at a step that is objected to. A step in which
nothing fails pays for no more than that one number.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import RigidfxError, SceneError, agree, trace_of

__all__ = ["Failures"]

T = TypeVar("T")


class Failures:
    """Keeps the first failure on this rank until all ranks are told.

    Attributes:
        t: Time at the start of the present step [s].
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        """Begin with none.

        Args:
            comm: Communicator of the mesh.
        """
        self._comm, self.t = comm, 0.0
        self._found: tuple[str, str] | None = None  # message, traceback

    @property
    def count(self) -> float:
        """One if there is a failure on this rank, zero if not: for a sum over ranks."""
        return float(self._found is not None)

    def heeded(
        self, owner: str, what: str, function: Callable[..., T], instead: Callable[..., T]
    ) -> Callable[..., T]:
        """A function that keeps exceptions of the given one, and goes on.

        Functions may fail on numbers that are not finite, as those of an iteration that runs away.

        Args:
            owner: Whose function it is, for the message.
            what: Which of its functions, likewise.
            function: The function.
            instead: A neutral result, of the same arguments.
        """

        def call(*given: Any) -> T:
            try:
                return function(*given)
            except Exception as error:  # whatever a user's function may raise
                if all(map(_finite, given)):
                    self.keep(owner, what, error)
                return instead(*given)

        return call

    def keep(self, owner: str, what: str, error: Exception) -> None:
        """Keep a failure of this rank, if it is the first.

        Args:
            owner: Whose function has failed.
            what: Which of its functions.
            error: The exception.
        """
        if self._found is not None:
            return
        found = (
            str(error)
            if isinstance(error, RigidfxError)
            else f"{owner}: its {what} failed in the step from t = {self.t:.9g} s with "
            f"{type(error).__name__}: {error}"
        )
        self._found = found, trace_of(error)

    def settle(self) -> None:
        """Raise an exception that any rank has kept. Collective.

        Raises:
            SceneError: On every rank, with the message and the traceback of the lowest rank that
                has kept one.
        """
        message, trace = self._found or (None, "")
        agree(self._comm, message, SceneError, trace)


def _finite(given: Any) -> bool:
    """Whether the arguments of a function are finite, as far as they are arrays or vectors."""
    values = getattr(given, "array_r", given)
    return not isinstance(values, np.ndarray) or bool(np.isfinite(values).all())
