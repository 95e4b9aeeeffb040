"""Parts that hardly bend, and what is behind them: a root turns all that hangs on it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

import rigidfx as rf

from .case import Run, case
from .twin import beside_its_twin

KAPPA, PART = 3.0, 0.01
PEAKS = {4.0: 7.16e-4, 12.0: 1.69e-4}  # 1/s, the largest strain rates of the flexible bar


def _bar(period: float) -> rf.Scene:
    """A bar with a stiff root, at whose end a sine pulls; its first period is 3.2 s."""

    def pull(t: float) -> float:
        return float(np.sin(2 * np.pi * t / period) * min(1.0, t / 0.1))

    box = rf.box((0, 0, 0), (8, 1, 1), (16, 2, 2)).with_cells("root", lambda x: x[0] <= 4 + 1e-9)
    soft, stiff = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e8))
    return rf.Scene(
        box.with_cells("rest", lambda x: x[0] >= 4 - 1e-9),
        {"root": stiff, "rest": soft},
        [rf.Fixed("x0"), rf.Traction("x1", (0, 0, 20.0), time=pull), rf.MassDamping(1.0)],
        probes={"tip": (8.0, 0.5, 0.5)},
    )


@case("rigid bodies", "a stiff root is quiet, and without its bend the tip is an eighth off")
def stiff_root(short: bool) -> Iterator[Run]:
    """The tip is off by no more than .8 κ tol over the peak rate, of its largest way."""
    bound, dt = 0.8 * KAPPA * PART, 0.02
    for period, peak in list(PEAKS.items())[: 1 if short else None]:
        rule = rf.StrainRate(PART * peak, 20 * dt, kappa=KAPPA)
        scene = partial(_bar, period)
        yield from beside_its_twin(f"{period:g} s", scene, dt, 2 * period, rule, bound)
