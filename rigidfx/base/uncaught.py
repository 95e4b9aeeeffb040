"""An error that ends the script on one rank ends it on all.

rigidfx raises its own errors on every rank. But a script may fail on a single one, in its own code
or where it makes an effect from bad values, while the others wait in a collective call for a rank
that is gone. `python3 -m mpi4py` is meant to end them, as Python ends on that rank; but before it
comes to that, PETSc's own end waits there for all ranks.
"""

from __future__ import annotations

import sys
import time
from types import TracebackType

from mpi4py import MPI

__all__ = ["end_together"]

PATIENCE = 5.0  # seconds that a rank that has failed waits for the others to fail, too
TAG = 31075  # of the messages in which ranks say that they have failed


def end_together(comm: MPI.Intracomm = MPI.COMM_WORLD) -> None:
    """Let an exception that nobody catches on one rank end all of them.

    Whatever handles such exceptions already shows it first. Where all ranks fail, each ends by
    itself. Nothing changes with one rank.

    Args:
        comm: Communicator of the ranks that one `mpirun` has started.
    """
    if comm.size == 1:
        return
    show = sys.excepthook

    def ended(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        show(kind, error, trace)
        if MPI.Is_finalized() or _all_fail(comm):
            return
        told = f"rigidfx: rank {comm.rank} of {comm.size} has failed without the others: all end."
        sys.stderr.write(told + "\n")
        sys.stdout.flush()
        sys.stderr.flush()
        comm.Abort(1)

    sys.excepthook = ended


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
