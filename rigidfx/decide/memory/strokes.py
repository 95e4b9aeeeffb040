"""The times in which a structure strains: what a strain rate is worth as a strain.

A rate that is quiet, for the time in which a motion turns round, is a strain that is quiet. Of all
that has been seen so far that time is the largest strain over the largest strain rate, a *stroke*.
A blow leaves a short one, below what rings after it: what then freezes withholds the strains it
rings with, and would wake at once. So there is also the time in which what moves *now* turns round,
of the last two windows: the largest swing of strains, from the least to the most of a cell, over
the largest rate; 1/ω of a vibration with ω. It counts only where a window has room for half a
period, π times that. What creeps back in shorter windows, slowly enough for cells to qualify, is on
its way by much more than it is seen to swing.
"""

from __future__ import annotations

from math import inf, log, pi

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.decide.memory.rise import Rise
from rigidfx.decide.memory.swings import Swings

__all__ = ["Strokes"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

EVERY = 2  # steps from look to look at strains
RECENT = 2  # windows that tell what moves now


class Strokes:
    """Remembers strains and strain rates of flexible cells.

    Attributes:
        time: Largest strain over largest rate at the end of the last window [s]; infinite while
            nothing but rounding has strained.
        rate_of_all: That on all ranks, at the end of the last window [1/s].
        last: The same of the last window alone [1/s].
        growth: By how much the largest rate so far has grown lately, at the end of the last window
            (`rigidfx.decide.memory.rise`).
        dying: Time in which rates die down, by the last two windows [s]; infinite where they do
            not.
        swung: For each owned cell by how much its strain has swung in the last window.
        seen: For each owned cell the time in which turned round what moved when it froze, or
            since [s]; of a flexible cell, what moves now. Zero where windows are too short.
    """

    def __init__(self, comm: MPI.Intracomm, cells: int) -> None:
        """Nothing has strained.

        Args:
            comm: Communicator of the mesh.
            cells: Number of owned cells.
        """
        self._comm, self._rise, self._strain = comm, Rise(comm), 0.0
        self.time, self.rate_of_all, self.last, self.dying = np.inf, 0.0, 0.0, inf
        self.growth = 1.0
        self.seen: Array = np.zeros(cells)
        self.swung: Array = np.zeros(cells)
        self._swings = Swings(cells)
        self._now = 0.0  # largest rate since the last window's end
        self._steps = 0
        self._windows: list[tuple[float, float]] = []  # largest rate and swing of the last ones

    @property
    def rate(self) -> float:
        """Largest rate on this rank so far [1/s]."""
        return self._rise.largest

    def add(self, rates: Array, start: float, t: float) -> bool:
        """Take note of the rates of a step.

        Args:
            rates: Of all owned cells [1/s].
            start: Time at its start [s].
            t: Time at its end [s].

        Returns:
            Whether strains are to be told, too.
        """
        self._now = max(self._now, float(rates.max(initial=0.0)))
        self._rise.add(self._now, start, t)
        self._steps += 1
        return self._steps % EVERY == 0

    def swing(self, cells: npt.NDArray[np.int32], strains: Array) -> None:
        """Take note of the strains at the end of a step.

        Args:
            cells: Flexible owned cells.
            strains: Of all owned cells.
        """
        self._swings.add(cells, strains)

    def look(self, strains: Array, noise: float, start: float, t: float, rigid: Bools) -> None:
        """Take note of the end of a window. Collective.

        Args:
            strains: Of all owned cells.
            noise: Strain rate that rounding may leave [1/s].
            start: When it began [s].
            t: When it ends [s].
            rigid: Owned cells of bodies, before any decision.
        """
        self._strain = max(self._strain, float(strains.max(initial=0.0)))
        self.swung = self._swings.end()
        swing = float(self.swung.max(initial=0.0))
        largest = np.array([self.rate, self._strain, self._now, swing])
        self._comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        rate, strain, now, swing = map(float, largest)
        self.growth, length = self._rise.growth(start, t), t - start
        self.dying = length / log(self.last / now) if 0 < now < self.last else inf
        self.rate_of_all, self.last = rate, now
        if rate > noise and strain > 0:
            self.time = strain / rate
        # Where all is rigid nothing moves, and what was seen last holds.
        if now > noise:
            self._windows = [*self._windows, (now, swing)][-RECENT:]
        recent = self.turning
        seen = recent if pi * recent <= length else 0.0
        self.seen = np.where(rigid, np.maximum(self.seen, seen), seen)
        self._now = 0.0

    def of_strains(self, length: float, other: float = inf, *, once: bool = False) -> Array:
        """Times for which each owned cell may withhold a rate that wakes it [s].

        A body that freezes at one turn of a motion has withheld twice its size at the other.

        Args:
            length: Length of a window [s].
            other: What counts while no stroke is known [s].
            once: Whether a window's strain, or a stroke's, counts once: bodies that each bend by
                what it may add up.
        """
        stroke = self.time if np.isfinite(self.time) else other
        return np.maximum((1 if once else 2) * min(length, stroke), 2 * self.seen)

    @property
    def turning(self) -> float:
        """Time in which what moves now turns round [s]; zero while nothing has moved."""
        if not self._windows:
            return 0.0
        rate, swing = np.max(self._windows, axis=0)
        return float(swing / rate)
