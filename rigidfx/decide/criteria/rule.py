"""Rules: which cells are quiet enough to be rigid, and which rigid cells wake.

A policy calls a rule. A rule knows neither earlier windows nor connected cells nor releases.
"""

from __future__ import annotations

from typing import Protocol

from rigidfx.base.types import Array, Bools
from rigidfx.decide.criteria.observation import Observation
from rigidfx.error.strained import Limits, Strained
from rigidfx.report.ledger import Rigidity

__all__ = ["Rule"]


class Rule(Protocol):
    """The measure by which a criterion judges cells."""

    @property
    def tol(self) -> Array:
        """Strain rate up to which each owned cell is quiet now [1/s]."""
        ...

    def limits(self) -> Limits:
        """Rates that wake cells in the next step. Collective."""
        ...

    @property
    def rigidity(self) -> Rigidity | None:
        """Error of the motion by bodies; None if that is not estimated."""
        ...

    def length(self) -> float:
        """How long a window is to be [s]; NaN while that is not known. Collective."""
        ...

    def observe(self, seen: Observation) -> None:
        """Record a step that was accepted, once observation has begun. Collective."""
        ...

    def window_ends(self, seen: Observation, flexible: Bools) -> None:
        """Record the end of a window, before `tol` is asked. Collective.

        Args:
            seen: The state at that time.
            flexible: Owned cells that were flexible in all of the window.
        """
        ...

    def told(self) -> str:
        """The settings by hand with the same result. Collective."""
        ...

    def waking(self, strained: Strained, free: Bools) -> Bools:
        """Which owned cells wake; those round them do as well. Collective.

        Args:
            strained: Strain of cells of bodies, over `limits`.
            free: Owned cells of bodies that may wake.
        """
        ...
