"""Numbers of the loop in which bodies that were found grow shapes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class GrowthControl:
    """Numbers of the loop, from runs of demos/benchmarks/waking.py beside flexible twins.

    Attributes:
        gate: Part of the tolerance up to which no response is solved for, by the last ratio of
            response to forces.
        every: Steps after which one is solved for in any case.
        wakes: Tolerances above which cells wake, if two more shapes in a step have not halved it.
        grown: Shapes beside the modes with which a body is full.
        woken: Tolerances above which a cell wakes then.
        nonlinear: Part of ½ q·Ωq by which the energy of a body may differ from its expansion. A
            frequency is off by ¾ of it: 0.003 is one swing of an arm at 1 %.
        doubled: Factor of ½ q·Ωq after which that is looked at again.
        least: Part of the largest ½ q·Ωq so far below which it is not.
        share: Part of the largest miss of any node, by mass, above which cells wake.
        periods: Periods in which a vibration falls to 1/e, as with 1.6 % of critical damping: what
            is in tune, or out of phase, adds up for as long.
    """

    gate: float = 0.5
    every: int = 20
    wakes: float = 3.0
    grown: int = 24
    woken: float = 0.5
    nonlinear: float = 0.003
    doubled: float = 2.0
    least: float = 1e-6
    share: float = 0.3
    periods: float = 10.0
