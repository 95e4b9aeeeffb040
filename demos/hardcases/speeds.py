"""Motions at two speeds, one after the other: a tolerance of rates says little of the slow one."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

import rigidfx as rf

from .case import Run, case
from .twin import PROMISED, beside_its_twin

PART = 0.01
PEAK = 0.0224  # 1/s, the largest strain rate of the flexible bar, in the blow


def _bar(slow_from: float, blow_at: float) -> rf.Scene:
    """A soft bar with a stiff end that a sine bends slowly and far, and a blow strains fast."""

    def slowly(t: float) -> float:
        t -= slow_from
        return float(np.sin(2 * np.pi * t / 3.0) * min(1.0, t / 3.0)) if t > 0 else 0.0

    def blow(t: float) -> float:
        t -= blow_at
        return float(np.sin(np.pi * t / 0.2) ** 2) if 0 < t < 0.2 else 0.0

    box = rf.box((0, 0, 0), (8, 1, 1), (16, 2, 2)).with_cells("end", lambda x: x[0] >= 6 - 1e-9)
    soft, stiff = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e9))
    return rf.Scene(
        box.with_cells("bar", lambda x: x[0] <= 6 + 1e-9),
        {"bar": soft, "end": stiff},
        [
            rf.Fixed("x0"),
            rf.Traction("x1", (0, 0, 20.0), time=slowly),
            rf.Traction("x1", (-1500.0, 0, 0), time=blow),
            rf.MassDamping(1.0),
        ],
        probes={"tip": (8.0, 0.5, 0.5)},
    )


@case("rigid bodies", "a slow motion before a blow, and after one, at a hundredth of its rates")
def slow_beside_fast(short: bool) -> Iterator[Run]:
    """The tip is off by no more than 2.4 tol over the peak rate, of its largest way."""
    bound, dt = PROMISED * PART, 0.01
    orders = (
        {"slow first": (0.0, 3.0, 4.2)}
        if short
        else {
            "slow first": (0.0, 4.0, 6.0),
            "blow first": (6.0, 0.5, 12.0),
        }
    )
    rule = rf.StrainRate(PART * PEAK, 20 * dt)
    for order, (slow_from, blow_at, t_end) in orders.items():
        scene = partial(_bar, slow_from, blow_at)
        yield from beside_its_twin(order, scene, dt, t_end, rule, bound)
