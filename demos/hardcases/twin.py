"""Parts that hardly bend beside flexible twins: by their lever, near resonances, at two speeds."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

import rigidfx as rf

from .case import History, Run, between, case

PROMISED = 2.4  # the error, over its largest way, that tol / peak strain rate brings at most
PART = 0.01  # tolerance over the peak
# Largest strain rates of flexible bars [1/s]: with a stiff root, by period; of a block on a stalk,
# by mass; of a bar that is struck.
PEAKS, SHAKEN, STRUCK = (
    {4.0: 7.16e-4, 12.0: 1.69e-4},
    {"consistent": 0.105, "lumped": 0.111},
    0.0224,
)


def beside_its_twin(
    name: str, scene: Callable[[], rf.Scene], dt: float, t_end: float, peak: float
) -> Iterator[Run]:
    """The flexible run, then the adaptive one, of a scene with a probe "tip".

    The tip may be off by 2.4 tol over the peak rate [1/s], of its largest way.
    """
    rule, bound = rf.StrainRate(PART * peak, 20 * dt), PROMISED * PART
    tips: list[np.ndarray] = []

    def near(history: History) -> str:
        """Of the flexible run first, then of the other."""
        tips.append(history.probe("tip"))
        off = np.abs(tips[-1] - tips[0]).max() / np.abs(tips[0]).max()
        return "" if off <= bound else f"the tip is off by {off:.1%}, the bound is {bound:.1%}"

    yield Run(f"flexible, {name}", scene(), dt, t_end, momentum=None, check=near)
    yield Run(f"adaptive, {name}", scene(), dt, t_end, rule, momentum=None, check=near)


def _bar(
    cut: float, E: tuple[float, float], *effects: rf.effects.Effect, across: int = 2, **how: Any
) -> rf.Scene:
    """A damped bar of 8 m, of two moduli [Pa] before and behind a cut [m]."""
    domain = rf.box((0, 0, 0), (8, 1, 1), (16, across, across))
    domain = domain.with_cells("near", between(0, cut)).with_cells("far", between(cut, 8))
    near, far = (rf.StVenantKirchhoff(E=each, nu=0.3, rho=1000.0) for each in E)
    given = [*effects, rf.MassDamping(1.0)]
    return rf.Scene(domain, {"near": near, "far": far}, given, probes={"tip": (8, 0.5, 0.5)}, **how)


def _on_a_root(period: float) -> rf.Scene:
    """A bar with a stiff root, at whose end a sine pulls; its first period is 3.2 s."""

    def pull(t: float) -> float:
        return float(np.sin(2 * np.pi * t / period) * min(1.0, t / 0.1))

    return _bar(4, (1e8, 1e6), rf.Fixed("x0"), rf.Traction("x1", (0, 0, 20.0), time=pull))


@case("rigid bodies", "a stiff root is quiet, and without its bend the tip is an eighth off")
def stiff_root(short: bool) -> Iterator[Run]:
    """The tip is off by no more than 2.4 tol over the peak rate, of its largest way."""
    for period, peak in list(PEAKS.items())[: 1 if short else None]:
        scene = partial(_on_a_root, period)
        dt = 0.04 if short else 0.02  # s
        yield from beside_its_twin(f"{period:g} s", scene, dt, 2 * period, peak)


def _stand(period: float, mass: str) -> rf.Scene:
    """A block on a soft stalk, on a base that shakes between its second and third frequency."""

    def shaken(t: float) -> tuple[float, float, float]:
        grown = min(1.0, t / (2 * period)) ** 3
        return 0.0, 0.0, float(0.02 * np.sin(2 * np.pi * t / period) * grown)

    base = rf.PrescribedMotion("x0", displacement=shaken)
    return _bar(2, (1e6, 1e8), base, across=1, mass=mass)


@case("rigid bodies", "a base shakes between two modes, which amplify what bodies withhold")
def shaken_base(short: bool) -> Iterator[Run]:
    """The tip is off by no more than 2.4 tol over the peak rate, of its largest way."""
    for mass, peak in list(SHAKEN.items())[: 1 if short else None]:
        dt, t_end = (0.04, 8.0) if short else (0.02, 10.0)  # s
        yield from beside_its_twin(f"{mass} mass", partial(_stand, 1.0, mass), dt, t_end, peak)


def _struck(slow_from: float, blow_at: float) -> rf.Scene:
    """A soft bar with a stiff end that a sine bends slowly and far, and a blow strains fast."""

    def slowly(t: float) -> float:
        t -= slow_from
        return float(np.sin(2 * np.pi * t / 3.0) * min(1.0, t / 3.0)) if t > 0 else 0.0

    def blow(t: float) -> float:
        t -= blow_at
        return float(np.sin(np.pi * t / 0.2) ** 2) if 0 < t < 0.2 else 0.0

    both = ((0, 0, 20.0), slowly), ((-1500.0, 0, 0), blow)
    loads = [rf.Traction("x1", force, time=time) for force, time in both]
    return _bar(6, (1e6, 1e9), rf.Fixed("x0"), *loads)


@case("rigid bodies", "a slow motion before a blow, and after one, at a hundredth of its rates")
def slow_beside_fast(short: bool) -> Iterator[Run]:
    """The tip is off by no more than 2.4 tol over the peak rate, of its largest way."""
    orders = {"slow first": (0.0, 4.0, 6.0), "blow first": (6.0, 0.5, 12.0)}
    if short:
        orders = {"slow first": (0.0, 3.0, 4.2)}
    for order, (slow_from, blow_at, t_end) in orders.items():
        scene = partial(_struck, slow_from, blow_at)
        yield from beside_its_twin(order, scene, 0.02 if short else 0.01, t_end, STRUCK)
