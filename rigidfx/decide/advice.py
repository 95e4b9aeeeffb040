"""Warnings of a policy, each given once, with their remedies."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.decide.criteria.judging import Criterion


class Advice:
    """Warns on rank 0, of each thing once."""

    def __init__(self, comm: MPI.Intracomm, criterion: Criterion, said: set[str]) -> None:
        """Keep the warnings given so far.

        Args:
            comm: Communicator of the mesh.
            criterion: The criterion of the user.
            said: Kinds of warnings that were given; those of this one are added.
        """
        self._comm, self._criterion, self._said = comm, criterion, said

    def of_window(self, period: float, tol: Array, noise: float) -> None:
        """Warn of a window shorter than a period, and of a tolerance below noise. Collective.

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
        """Warn of bodies that are released soon after each freeze."""
        self._say(
            "bodies are released again and again, sooner than they were observed: their "
            f"cells have to qualify for longer and longer now (patience). {self._criterion.remedy}"
        )

    def of_failure(self, error: Exception) -> None:
        """Warn of an estimate that failed, so that nothing freezes in this window."""
        self._say(
            f"an estimate at the end of a window failed ({error}), and nothing freezes in such a "
            "window. The motion is computed as before; bodies that exist stay."
        )

    def _say(self, message: str) -> None:
        kind = message.split(",")[0]
        if kind not in self._said:
            self._said.add(kind)
            warn(self._comm, f"{self._criterion.owner}: {message}")
