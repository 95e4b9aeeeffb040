"""What a policy warns of, once each, and what helps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.base.warning import warn
from rigidfx.decide.criteria.judging import Criterion
from rigidfx.decide.memory.strokes import Strokes
from rigidfx.shadow.motion import Strained

__all__ = ["Advice", "Seen"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Seen:
    """What the strains of named parts are compared with.

    Attributes:
        limits: Strain rate that would wake each owned cell [1/s]; None if none does.
        strokes: What flexible cells have strained so far.
        t: Time [s].
    """

    limits: Array | None
    strokes: Strokes
    t: float


class Advice:
    """Warns on rank 0, of each thing once."""

    def __init__(self, comm: MPI.Intracomm, criterion: Criterion, said: set[str]) -> None:
        """Take over what has been said.

        Args:
            comm: Communicator of the mesh.
            criterion: What the user states.
            said: Kinds of warnings that were given; those of this one are added.
        """
        self._comm, self._criterion, self._said = comm, criterion, said

    def of_window(self, period: float, tol: Array, noise: float) -> None:
        """Of a window shorter than a period, and of a tolerance below noise. Collective.

        Args:
            period: Longest period seen [s].
            tol: Tolerance of each owned cell [1/s].
            noise: Strain rate that the end of Newton's iteration may leave [1/s].
        """
        window = self._criterion.window
        # Where forces wake cells, those that have qualified at the turn of a vibration wake again.
        looks_on = self._criterion.wake == "local"
        if not isinstance(window, str) and window < period and not looks_on:
            self._say(
                f"the window of observation, {window:.3g} s, is shorter than the longest "
                f"period seen, {period:.3g} s: cells may qualify at the turn of a vibration. Take "
                f"window ≥ {period:.3g}, or 'auto'."
            )
        least = self._comm.allreduce(tol[tol > 0].min(initial=np.inf), op=MPI.MIN)
        if least < noise:
            self._say(
                f"the tolerance {least:.3g} 1/s is below what the end of Newton's "
                f"iteration may leave in the strain rates, {noise:.3g} 1/s: decisions are at "
                "random. Take a larger tolerance or a larger Δt."
            )

    def of_haste(self) -> None:
        """Of bodies that are released soon after each freeze."""
        self._say(
            "bodies are released again and again, sooner than they were observed: their "
            f"cells have to qualify for longer and longer now (patience). {self._criterion.remedy}"
        )

    def of_named(
        self, parts: Mapping[str, npt.NDArray[np.int32]], strained: Strained, seen: Seen
    ) -> None:
        """Of parts that are named rigid and withhold too much. Collective.

        They are there before anything has been observed, unlike those that are found: nothing is
        said of them until then, and of strains that add up none until a stroke is known.

        Args:
            parts: Owned cells of each, by name.
            strained: What each owned cell would strain, over what wakes it.
            seen: The limits, and what flexible cells have strained.
        """
        ratio, strained_at, limits = strained.ratio, np.zeros_like(strained.rate), seen.limits
        if limits is not None:
            moved = bool(np.isfinite(seen.strokes.time))
            if seen.t <= self._criterion.since or (self._criterion.relative and not moved):
                return
            ratio = ratio if moved else strained.rate
            known = (limits > 0) & np.isfinite(limits)
            np.multiply(strained.rate, limits, out=strained_at, where=known)
        for name, own in parts.items():
            local = [ratio[own].max(initial=0.0), strained_at[own].max(initial=0)]
            largest, rate, peak = _largest(self._comm, [*local, seen.strokes.rate])
            if largest <= 1:
                continue
            worst = "altogether" if rate > 0 else "by more than was asked"
            off = f"by some {rate / peak:.1%}" if 0 < rate < peak else worst
            self._say(
                f"forces would strain the part '{name}' that is named Rigid, at {largest:.2g} "
                f"times {self._criterion.limit} at t = {seen.t:.6g} s. It stays "
                f"rigid, and what follows lacks these strains: the motion may be off {off}, and "
                f"by more near a resonance. Do not name it, or {self._criterion.pardon} if that "
                "is meant."
            )

    def _say(self, message: str) -> None:
        kind = message.split(",")[0]
        if kind not in self._said:
            self._said.add(kind)
            warn(self._comm, f"{type(self._criterion).__name__}: {message}")


def _largest(comm: MPI.Intracomm, values: list[float]) -> list[float]:
    """The largest of each value over the ranks. Collective."""
    out = np.array(values, dtype=np.float64)
    comm.Allreduce(MPI.IN_PLACE, out, op=MPI.MAX)
    return [float(value) for value in out]
