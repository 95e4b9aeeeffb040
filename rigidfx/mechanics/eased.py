"""Stress that fades after a release, in place of a sudden cut.

Rigidity bears the forces that would strain a body. If its cells were cut free at once, they would
vibrate about the shape that these forces give them. So the missing stress of that shape acts on for
a while, and fades. The cells start with the acceleration of the error motion, without a jump.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, pi

import numpy as np

from rigidfx.base.remembered import Each, Record
from rigidfx.base.types import Array, Indices

__all__ = ["EASED", "Eased"]


@dataclass(frozen=True)
class Eased:
    """Cells that a release has eased.

    Attributes:
        cells: These owned cells, sorted.
        nodes: Their local nodes, sorted.
        shape: Displacements of these at the release, shape (nodes, 3) [m].
        strained: Their shape as forces would strain the cells, likewise.
        since: Time of the release [s].
        span: How long the stress takes to fade [s].
    """

    cells: Indices
    nodes: Indices
    shape: Array
    strained: Array
    since: float
    span: float

    def without(self, cells: Indices) -> Eased:
        """The same without some cells, which have become rigid."""
        return replace(self, cells=np.setdiff1d(self.cells, cells))

    def part(self, t: float) -> float:
        """Remaining part of the stress at t [s]: ½ (1 + cos π(t - t₀)/T)."""
        return 0.0 if self.over(t) else 0.5 * (1 + cos(pi * (t - self.since) / self.span))

    def over(self, t: float) -> bool:
        """Whether it has faded at t [s]."""
        return t - self.since >= self.span


EASED = Each(Record(Eased, "nodes", ["shape", "strained"], ["cells"], ghosts=True))
