"""The errors rigidfx raises, and the one way to raise them on every rank at once.

An error found on one rank only would leave the others waiting in their next collective call. What
can be judged from global data is therefore raised directly; what is judged from a rank's own cells
or files goes through `agree`.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite, isnan
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    from mpi4py import MPI

__all__ = [
    "InversionError",
    "OutputError",
    "RigidfxError",
    "RigidfxWarning",
    "SceneError",
    "StepError",
    "agree",
    "number",
    "positive",
    "together",
]

T = TypeVar("T")


class RigidfxError(Exception):
    """Base of all errors of this package."""


class RigidfxWarning(UserWarning):
    """A run goes on, but what it finds may not be what was wanted. Shown on rank 0."""


class SceneError(RigidfxError, ValueError):
    """The problem as described cannot be simulated: a name, a number or a combination is wrong."""


class StepError(RigidfxError, RuntimeError):
    """A time step or a static solution did not converge, even after cutting."""


class InversionError(StepError):
    """A flexible cell was turned inside out or torn apart, in however short a step."""


class OutputError(RigidfxError, OSError):
    """Results cannot be written where they should go."""


def agree(comm: MPI.Intracomm, message: str | None, error: type[RigidfxError] = SceneError) -> None:
    """Raise `error` on all ranks as soon as one rank has a message. Collective.

    Args:
        comm: Communicator of the mesh.
        message: What is wrong on this rank, or None.
        error: Class to raise; its text is the message of the lowest rank that has one.

    Raises:
        RigidfxError: Of class `error`, on every rank alike.
    """
    messages = [m for m in comm.allgather(message) if m is not None]
    if messages:
        raise error(messages[0])


def together(comm: MPI.Intracomm, owner: str, function: Callable[[], T]) -> T:
    """Call a user's function on all ranks; if it fails on one, all raise. Collective.

    Args:
        comm: Communicator of the mesh.
        owner: Whose function it is, for the message.
        function: Function to call.

    Raises:
        SceneError: On every rank, with the message of the lowest rank that failed.
    """
    problem, value = None, None
    try:
        value = function()
    except RigidfxError as error:
        problem = str(error)
    except Exception as error:  # whatever a user's function may raise
        problem = f"{owner} failed with {type(error).__name__}: {error}"
    agree(comm, problem)
    return value  # type: ignore[return-value]


def number(owner: str, name: str, value: Any, *, infinite: bool = False) -> float:
    """A user's number as a float.

    Args:
        owner: Whose number it is, for the message.
        name: Name of the number.
        value: What was given.
        infinite: Whether plus or minus infinity will do.

    Raises:
        SceneError: If it is no number, or not finite where it has to be.
    """
    if not isinstance(value, (str, bool)) and value is not None and np.ndim(value) == 0:
        try:
            result = float(value)
        except (TypeError, ValueError):
            result = float("nan")
        if isfinite(result) or (infinite and not isnan(result)):
            return result
    raise SceneError(f"{owner}: {name} must be a finite number, got {value!r}.")


def positive(owner: str, name: str, value: Any, *, infinite: bool = False) -> float:
    """A user's number above zero as a float.

    Args:
        owner: Whose number it is, for the message.
        name: Name of the number.
        value: What was given.
        infinite: Whether infinity will do.

    Raises:
        SceneError: If it is no number, not above zero, or not finite where it has to be.
    """
    result = number(owner, name, value, infinite=infinite)
    if result > 0:
        return result
    kind = "number" if infinite else "finite number"
    raise SceneError(f"{owner}: {name} must be a {kind} > 0, got {value!r}.")
