"""The errors rigidfx raises, and the one way to raise them on every rank at once.

An error found on one rank only would leave the others waiting in their next collective call. So a
fault in data that all ranks share is raised directly, and one in a rank's own cells or files goes
through `agree`.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from mpi4py import MPI


T = TypeVar("T")


class RigidfxError(Exception):
    """Base of all errors of this package."""


class RigidfxWarning(UserWarning):
    """A run goes on, but its results may not be the wanted ones. Shown on rank 0."""


class SceneError(RigidfxError, ValueError):
    """The problem as described cannot be simulated: a name, a number or a combination is wrong."""


class StepError(RigidfxError, RuntimeError):
    """A time step or a static solution did not converge, even after cutting.

    Attributes:
        found: The event and its place.
        advice: The remedy.
        halvings: How often the step is to be halved before it is tried again.
    """

    def __init__(self, found: str, advice: str = "", halvings: int = 1) -> None:
        super().__init__(f"{found} {advice}".rstrip())
        self.found, self.advice, self.halvings = found, advice, halvings


class InversionError(StepError):
    """A flexible cell is inside out or torn apart, however short the step."""


class CompilerError(RigidfxError, RuntimeError):
    """A form cannot be compiled: there is no C compiler, or it fails."""


class OutputError(RigidfxError, OSError):
    """Results cannot be written to their folder, or cannot be read."""


class Trace(Exception):
    """Where an error has come from on some rank, as text, so that all ranks can show it.

    An error itself would keep alive, on one rank only, the objects of its traceback. PETSc's
    objects among that have to go on all ranks together: those made next would wait for ever.
    """

    def __str__(self) -> str:
        """The text apart from the line before."""
        return f"\n{self.args[0]}"


def trace_of(error: BaseException | None) -> str:
    """The traceback of an error as Python shows it; empty if there is none."""
    return "" if error is None else "".join(traceback.format_exception(error))


def agree(
    comm: MPI.Intracomm,
    message: str | None,
    error: type[RigidfxError] = SceneError,
    trace: str = "",
) -> None:
    """Raise `error` on all ranks as soon as one rank has a message. Collective.

    The lowest rank that has one is shown, with the trace of `trace_of` from there.
    """
    mine = None if message is None else (message, trace)
    for found in comm.allgather(mine) if comm.size > 1 else [mine]:
        if found is not None and found[1]:
            raise error(found[0]) from Trace(found[1])
        if found is not None:
            raise error(found[0])


def on_rank_0(
    comm: MPI.Intracomm,
    action: Callable[[], T],
    told: Callable[[Exception], str] = str,
    error: type[RigidfxError] = OutputError,
) -> T:
    """The result of an action of rank 0, such as reading a file, on all ranks. Collective.

    An error of this package is raised on every rank. One of the system, or of a value that cannot
    be written, is raised as `error`, in the words of `told`.
    """
    value: Any = None
    kind, text = None, ""
    if comm.rank == 0:
        try:
            value = action()
        except RigidfxError as raised:
            kind, text = type(raised), str(raised)
        except (OSError, ValueError) as raised:
            kind, text = error, told(raised)
    value, kind, text = comm.bcast((value, kind, text))
    if kind is not None:
        raise kind(text)
    return value


def by_name(owner: str, t: float | None, function: Callable[[], T], what: str = "function") -> T:
    """Call a user's function in a run, maybe at t [s]; if it fails, raise whose it is and when."""
    try:
        return function()
    except RigidfxError:
        raise
    except Exception as error:  # whatever a user's function may raise
        found, when = f"{type(error).__name__}: {error}", "" if t is None else f" at t = {t:g} s"
        raise SceneError(f"{owner}: its {what} failed{when} with {found}") from error


def together(comm: MPI.Intracomm, owner: str, function: Callable[[], T]) -> T:
    """Call a user's function; if it fails on one rank, all raise a `SceneError`. Collective."""
    problem, value, trace = None, None, ""
    try:
        value = function()
    except RigidfxError as error:
        problem, trace = str(error), trace_of(error.__cause__)
    except Exception as error:  # whatever a user's function may raise
        problem, trace = f"{owner} failed with {type(error).__name__}: {error}", trace_of(error)
    agree(comm, problem, SceneError, trace)
    return value  # type: ignore[return-value]
