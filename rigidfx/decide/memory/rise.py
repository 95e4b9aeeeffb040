"""Whether a motion begins: by how much it has grown lately.

What has been seen of a motion that begins tells little of what comes. One that sets in as t^p has
grown by 2^p in the last half of its time, however large it is and whenever one looks, and one that
swings has not. So what counts is growth in half of the window that ends, or of the time since the
motion was next to nothing if that is longer; another window may bring as much again. How much is
too much depends on what is followed: rates grow by half as much as strains do.
"""

from __future__ import annotations

from math import inf

from mpi4py import MPI

from rigidfx.base.course import Course

__all__ = ["Rise"]

HALF = 0.5
NOTHING = 1e-3  # of the largest value: so little was next to nothing


class Rise:
    """Follows the largest value of some measure of a motion.

    Attributes:
        largest: The largest on this rank so far.
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        """Nothing has moved.

        Args:
            comm: Ranks each of which adds what it has seen.
        """
        self._comm, self._course = comm, Course()

    @property
    def largest(self) -> float:
        """The largest on this rank so far."""
        return self._course.largest

    def add(self, value: float, start: float, t: float) -> None:
        """Take note of a value in a step between two times [s]."""
        self._course.add(value, start, t)

    def growth(self, start: float, t: float) -> float:
        """How many times what it was the largest value is, on all ranks. Collective.

        Args:
            start: When the window began that ends at t [s].
            t: Now [s].
        """
        largest = self._comm.allreduce(self._course.largest, op=MPI.MAX)
        small = NOTHING * largest  # more than that may never have been seen on this rank
        mine = self._course.until(small) if self._course.largest > small else inf
        begun = self._comm.allreduce(mine, op=MPI.MIN)
        ago = t - HALF * max(t - start, t - begun)
        before = self._comm.allreduce(self._course.at(ago), op=MPI.MAX)
        return float(largest / before) if before > 0 else inf if largest > 0 else 1.0
