"""Bars that show how far a run is, or a picture."""

import sys
from collections.abc import Iterable
from typing import TypeVar, cast

from mpi4py import MPI
from tqdm import tqdm

T = TypeVar("T")


def progress_bar(comm: MPI.Intracomm, t_end: float, progress: bool | None) -> tqdm:
    """A bar on rank 0 that counts simulated time [s]; by default where a terminal is."""
    terminal = sys.stderr.isatty()
    return tqdm(
        total=t_end,
        disable=comm.rank != 0 or not (terminal if progress is None else progress),
        unit="s",
        file=sys.stderr if terminal else _Lines(),
        mininterval=0.1 if terminal else 5.0,
        bar_format="{l_bar}{bar}| {n:.4g}/{total:.4g} s [{elapsed}<{remaining}]",
    )


def bar_over(items: Iterable[T], what: str, count: int) -> Iterable[T]:
    """The items, with a bar meanwhile where standard error is a terminal, behind what is done."""
    return cast(Iterable[T], tqdm(items, what, count, leave=False, disable=None))


class _Lines:
    """Standard error where it is no terminal: the bar as a line each time.

    mpirun passes on whole lines only, so that a bar that rewrites its line would not be seen.
    """

    def write(self, text: str) -> None:
        """Write a state of the bar, without control characters that move a cursor."""
        if text.strip():
            sys.stderr.write(text.strip() + "\n")

    def flush(self) -> None:
        """Flush standard error."""
        sys.stderr.flush()
