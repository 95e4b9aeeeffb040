"""Parts that hardly bend, and what that does elsewhere: by their lever, and near resonances."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

import rigidfx as rf

from .case import Run, case
from .twin import PROMISED, beside_its_twin

PART = 0.01
PEAKS = {4.0: 7.16e-4, 12.0: 1.69e-4}  # 1/s, the largest strain rates of the flexible bar
SHAKEN = {"consistent": 0.105, "lumped": 0.111}  # likewise of the block on a stalk, by its mass


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
    """The tip is off by no more than 2.4 tol over the peak rate, of its largest way."""
    bound, dt = PROMISED * PART, 0.02
    for period, peak in list(PEAKS.items())[: 1 if short else None]:
        rule = rf.StrainRate(PART * peak, 20 * dt)
        scene = partial(_bar, period)
        yield from beside_its_twin(f"{period:g} s", scene, dt, 2 * period, rule, bound)


def _stand(period: float, mass: str) -> rf.Scene:
    """A block on a soft stalk, on a base that shakes between its second and third frequency."""

    def shaken(t: float) -> tuple[float, float, float]:
        grown = min(1.0, t / (2 * period)) ** 3
        return 0.0, 0.0, float(0.02 * np.sin(2 * np.pi * t / period) * grown)

    box = rf.box((0, 0, 0), (8, 1, 1), (16, 1, 1)).with_cells("stalk", lambda x: x[0] <= 2 + 1e-9)
    soft, stiff = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e8))
    return rf.Scene(
        box.with_cells("block", lambda x: x[0] >= 2 - 1e-9),
        {"stalk": soft, "block": stiff},
        [rf.PrescribedMotion("x0", displacement=shaken), rf.MassDamping(1.0)],
        mass=mass,
        probes={"tip": (8.0, 0.5, 0.5)},
    )


@case("rigid bodies", "a base shakes between two modes, which amplify what bodies withhold")
def shaken_base(short: bool) -> Iterator[Run]:
    """The tip is off by no more than 2.4 tol over the peak rate, of its largest way."""
    bound, dt = PROMISED * PART, 0.02
    for mass, peak in list(SHAKEN.items())[: 1 if short else None]:
        rule = rf.StrainRate(PART * peak, 20 * dt)
        scene = partial(_stand, 1.0, mass)
        yield from beside_its_twin(f"{mass} mass", scene, dt, 10.0, rule, bound)
