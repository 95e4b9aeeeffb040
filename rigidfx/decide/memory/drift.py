"""How far a free motion has drifted from what it would be without rigid parts.

While loads rest, a structure vibrates at frequencies of its own, and rigid parts raise them: by
half the share of strain energy that their cells had (Rayleigh). However little that is, phases
drift apart as long as the motion lasts, and what it is off by is its drift times its size. So drift
is kept as a strain rate, the one that flexible cells are off by,

    e = Σ ½ ω s D_rigid/D ė Δt,

D the strain energy by which a cell has swung in the window before it froze, ė the largest rate of a
window; and e shrinks with ė as the motion dies down. It may be half of what wakes cells, κ tol, by
the end of the next window. s is told by shadows: what bodies withhold, ½ ρᵀK⁺ρ, over the part of it
in their own cells, for they hold what is round them, too: a small sphere twice the energy that it
would have (J. D. Eshelby, Proc. R. Soc. A 241 (1957) 376-396), large parts little more.

Both s D_rigid/D and what bodies withhold over the energy of strain are too much rather than too
little, and the lesser of them counts. The first is of the window before the freeze: where a motion
begins a stiff part has a share of the energy that it never has again. The second is of the window
that ends, but since its freeze a cell swings by up to twice its amplitude, and what loads have
changed since then is in it as well.

Where loads change it is they that say how fast all moves, and nothing drifts; but a structure that
gives way by less from the beginning is off by A s D_rigid/D, the part of its compliance that it
lacks (Castigliano), and that times ė may be as much. Of a vibration with the strain energy U and
the kinetic energy T in the mean, forced through K - ω²M, a part ε of the stiffness changes
ε U/(U - T): next to nothing more where loads are slow, a multiple of it near a resonance, where T
is U. Other modes that move as well hide what is near one, so A is the larger of the two over their
difference, up to ten, as damping and the time of a run bound that.

How long a free motion goes on nobody knows: it is expected to do so for as long as it has. One that
dies down as exp(-t/T) is off by most after T, by t exp(-t/T) = T/e in the place of that time.
"""

from __future__ import annotations

from math import e, inf

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

__all__ = ["Drift"]

MOST = 2.0  # times a motion is what it is off by, if it is in the opposite phase
AMPLIFIED = 10.0  # times, at most, what is off comes of a lack of compliance
FADING = 0.5  # of what windows tell of that, from one to the next: they may be shorter than a swing

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


class Drift:
    """Keeps the drift of the motion so far.

    Attributes:
        rate: Strain rate that flexible cells are off by [1/s].
        limit: What that may be [1/s].
        driven: Strain rate that is to the last one what a motion may be off by is to how far it has
            gone in the last window [1/s].
        stiffening: s of the bodies, or of the last ones that there were.
        amplification: A of the last windows.
        stiffer: Part by which bodies stiffened the structure in the last window, at most.
        share: Part of the strain energy of the motion that rigid cells had as they froze.
        shares: That of each owned cell in the last window in which it was flexible.
    """

    def __init__(self, comm: MPI.Intracomm, cells: int) -> None:
        """Nothing has drifted.

        Args:
            comm: Communicator of the mesh.
            cells: Number of owned cells.
        """
        self._comm = comm
        self.shares: Array = np.zeros(cells)
        self.rate, self.limit, self.driven, self.share, self.stiffening = 0.0, inf, inf, 0.0, 1.0
        self.amplification = 1.0
        self.stiffer = 0.0
        self._most = 0.0, 0.0  # energies that bodies withhold, and of strain, in the window
        self._moving = 0.0, 0.0  # kinetic and strain energies while loads change, added up
        self._moved = False  # in a window before: what begins has as much of both, however slow
        self._last = 0.0  # largest rate of the last window
        self._next = 0.0  # drift in it, as in the next
        self._first, self._lasted = 0.0, 0.0  # that of a free motion's first window; time since

    def add(self, kinetic: float, strain: float) -> None:
        """Take note of the energies of deformation in a step in which loads change [J]."""
        self._moving = self._moving[0] + kinetic, self._moving[1] + strain

    def compare(self, withheld: float, strain: float) -> None:
        """Take note of what bodies withhold, and of the energy of strain, after a step [J]."""
        self._most = max(self._most[0], withheld), max(self._most[1], strain)

    def window_ends(
        self, energy: Array, rigid: Bools, rate: float, turning: float, length: float, rested: float
    ) -> None:
        """Take note of the end of a window. Collective.

        Args:
            energy: Of strain, of each owned cell that is flexible; zero of others.
            rigid: Owned cells of bodies, before any decision.
            rate: Largest strain rate of any cell in it [1/s].
            turning: Time in which the motion turns round, 1/ω [s]; 0 where nothing drifts.
            length: Length of the window [s].
            rested: Time in which loads have rested [s].
        """
        local = np.array([self.shares[rigid].sum(), energy.sum()])
        self._comm.Allreduce(MPI.IN_PLACE, local, op=MPI.SUM)
        self.share, total = min(float(local[0]), 1.0), float(local[1])
        if total > 0:
            self.shares = np.where(rigid, self.shares, energy / total * (1 - self.share))
        self.stiffer = self.stiffening * self.share
        withheld, strain = self._most
        if min(withheld, strain) > 0:
            self.stiffer = min(self.stiffer, withheld / strain)
        self._most = 0.0, 0.0
        if 0 < rate < self._last:
            self.rate *= rate / self._last
        self._last = rate
        self._next = 0.0
        T, U = self._moving
        more = max(T, U) if self._moved else 0.0
        self.amplification = more / max(abs(U - T), more / AMPLIFIED) if more > 0 else 1.0
        self._moving, self._moved = (FADING * T, FADING * U), U > 0
        if rested < length:
            self._first = self._lasted = 0.0
        if turning > 0:
            drifting = min(rested, length)
            self._next = 0.5 * self.stiffer * rate * length / turning
            self.rate = min(self.rate + self._next * drifting / length, MOST * rate)
            self._first = self._first or rate
            self._lasted += drifting

    @property
    def too_far(self) -> bool:
        """Whether it has drifted too far by the end of a window that is as the last."""
        return self.rate > 0 and min(self.rate + self._next, MOST * self._last) > self.limit

    @property
    def room_to_go(self) -> float:
        """Share of the energy that may be rigid for how far a driven motion goes."""
        much = self.stiffening * self._last * self.amplification
        return self.driven / much if much > 0 else inf

    def room(self, turning: float, free: bool) -> float:
        """Share of the energy that may be rigid.

        Args:
            turning: Time in which the motion turns round, 1/ω [s].
            free: Whether loads rest, so that it drifts.
        """
        much = self.stiffening * self._last * (1.0 if free else self.amplification)
        stiffer = self.limit / much if much > 0 else inf
        if not free or MOST * self._last <= self.limit:
            return stiffer
        time = self._lasted
        if 0 < self._last < self._first:
            time /= max(1.0, e * float(np.log(self._first / self._last)))
        off = 0.5 * self.stiffening * self._last * time / turning
        return min(stiffer, (self.limit - self.rate) / off) if off > 0 else stiffer
