"""An error on one rank ends all ranks.

rigidfx raises its own errors on every rank. But a script may fail on a single one, in its own code,
where it makes an effect from bad values, or in a function that a step calls for the nodes and cells
of that rank. The others then wait in a collective call for a rank that is gone.
`python3 -m mpi4py` is meant to end them, as Python ends on that rank; but before it comes to that,
PETSc's own end waits there for all ranks.
"""

import sys
import time
import traceback
from collections.abc import Callable
from types import TracebackType
from typing import TypeVar

from mpi4py import MPI

from rigidfx.base.errors import RigidfxError, by_name

T = TypeVar("T")

PATIENCE = 5.0  # seconds that a rank that has failed waits for the others to fail, too
TAG = 31075  # of the messages in which ranks say that they have failed


def end_together(comm: MPI.Intracomm = MPI.COMM_WORLD) -> None:
    """Let an exception that nobody catches on one rank of `mpirun` end all of them.

    Whatever handles such exceptions already shows it first. Where all ranks fail, each ends by
    itself. Nothing changes with one rank.
    """
    if comm.size == 1:
        return
    show = sys.excepthook

    def ended(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        show(kind, error, trace)
        if not MPI.Is_finalized() and not _all_fail(comm):
            _end(comm)

    sys.excepthook = ended


def by_users(comm: MPI.Intracomm, owner: str, what: str, function: Callable[[], T]) -> T:
    """Call a user's function where ranks do not meet; a failure on some of them ends all.

    A failure on all ranks raises a `RigidfxError` that names the owner and the function.
    """
    try:
        return by_name(owner, None, function, what)
    except RigidfxError as error:  # nothing collective may come in between
        if comm.size > 1 and not _all_fail(comm):
            traceback.print_exception(error)
            _end(comm)
        raise


def on_all_ranks(comm: MPI.Intracomm, kind: type[BaseException] | None) -> bool:
    """Whether all ranks come to the end of a context, which an error of this class may have ended.

    Other errors than those of this package may be one rank's own.
    """
    return kind is None or comm.size == 1 or issubclass(kind, RigidfxError)


def _end(comm: MPI.Intracomm) -> None:
    told = f"rigidfx: rank {comm.rank} of {comm.size} has failed without the others: all end."
    sys.stderr.write(told + "\n")
    sys.stdout.flush()
    sys.stderr.flush()
    comm.Abort(1)


def _all_fail(comm: MPI.Intracomm) -> bool:
    """Whether all ranks come here within the time that a rank waits."""
    others = [rank for rank in range(comm.size) if rank != comm.rank]
    heard = [comm.Irecv(bytearray(), source=rank, tag=TAG) for rank in others]
    said = [comm.Isend(b"", dest=rank, tag=TAG) for rank in others]
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if MPI.Request.Testall(heard + said):
            return True
        time.sleep(0.01)
    return False
