"""Rigid while loads act: what waking by forces finds, misses, and costs, against flexible twins.

Each scene runs fully flexible and with `StrainRate(…, wake="local")`, the two in turn, and the
strain rates of the flexible twin judge the other run, in windows of 20 steps:

- needed: cell-windows in which the twin strains at more than twice κ tol; missed: the share of
  them in which the cell was rigid when the twin crossed that and one step later;
- woken: cells above the threshold, without the ring round them; false: the share of them that
  stays below tol in the twin for two windows from then on;
- quiet_share: cell-windows below tol in the twin; rigid_share: rigid time × cells;
- error of the probe relative to its largest displacement, and of the energy;
- events: freezes and releases; repeats: steps solved twice, as the check found what the prediction
  had not;
- time_ratio: wall time over that of the twin; prediction_share: the part of it in which shadows
  take their steps; shadow_factor_share: that in which they are made and factored.

    ./fenicsx python3 demos/benchmarks/waking.py --across 6
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from bench import Parser, Turns, chosen, conclude
from petsc4py import PETSc

import rigidfx as rf
from meshes.gong import MALLET, SIDE, gong
from rigidfx.decide.policy import CHECKED

KAPPA = 3.0
WINDOW = 20  # steps
SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)  # Pa, 1, kg/m³
STIFF = rf.StVenantKirchhoff(E=1e8, nu=0.3, rho=1000.0)
BASE = rf.Fixed("x0")
Effects = list[rf.effects.Effect]


def pulse(start: float, length: float) -> Callable[[float], float]:
    """A smooth push of height one."""
    return lambda t: float(start < t < start + length) * np.sin(np.pi * (t - start) / length) ** 2


def sine(period: float) -> Callable[[float], float]:
    """A sine that begins gently."""
    return lambda t: np.sin(2 * np.pi * t / period) * min(1.0, t / period)


def shake(t: float) -> tuple[float, float, float]:
    """A path of the ground: the same ten sines in each run [m]."""
    random = np.random.default_rng(5)
    frequency, phase = random.uniform(0.05, 0.6, 10), random.uniform(0, 2 * np.pi, 10)
    waves = np.sin(2 * np.pi * frequency * t + phase) - np.sin(phase)
    return 0.0, 0.0, float(2e-3 * (waves / frequency).sum() * min(1.0, t / 4) ** 2)


def swinging(period: float, reach: float) -> Callable[[float], tuple[float, float, float]]:
    """A path that swings sideways [m]."""
    wave = sine(period)
    return lambda t: (0.0, 0.0, reach * float(wave(t)))


def turning(t: float) -> tuple[float, float, float]:
    """A gravity that turns once in 12 s [m/s²]."""
    rise = 0.1 * min(1.0, t / 6)
    return 0.0, rise * np.sin(2 * np.pi * t / 12), -rise * np.cos(2 * np.pi * t / 12)


@dataclass(frozen=True)
class Case:
    """A bar, its outer half a stiff block or as soft as the rest, and what acts on it.

    Attributes:
        effects: What acts, supports included.
        block: Whether the outer half is stiff.
        tol: Tolerance over the peak strain rate of the twin.
        dt: Δt [s].
        t_end: End [s].
        damping: α of the drag [1/s].
    """

    effects: Callable[[], Effects]
    block: bool = True
    tol: float = 0.01
    dt: float = 0.02
    t_end: float = 16.0
    damping: float = 1.0

    def scene(self, across: int) -> rf.Scene:
        """The problem on a mesh of so many cells across."""
        box = rf.box((0, 0, 0), (8, 1, 1), (8 * across, across, across))
        box = box.with_cells("stalk", lambda x: x[0] <= 4 + 1e-9)
        box = box.with_cells("block", lambda x: x[0] >= 4 - 1e-9)
        materials = {"stalk": SOFT, "block": STIFF if self.block else SOFT}
        drag = [rf.MassDamping(self.damping)] if self.damping else []
        return rf.Scene(box, materials, [*self.effects(), *drag], probes={"tip": (8, 0.5, 0.5)})


@dataclass(frozen=True)
class Gong(Case):
    """A plate with a heavy hub instead, of demos/gong.py."""

    def scene(self, across: int) -> rf.Scene:
        """The problem on a mesh of eight times as many cells along a side, in sixteens."""
        plate = rf.StVenantKirchhoff(E=3e9, nu=0.3, rho=1200.0)
        steel = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7800.0)
        return rf.Scene(
            gong(16 * max(1, across // 2)),
            {"plate": plate, "hub": steel},
            self.effects(),
            element="enhanced",
            probes={"tip": (SIDE, SIDE, 0)},
        )


def struck() -> Effects:
    """The plate damped, in soft springs, in which it swings, and two blows."""
    pressure = (0.0, 0.0, -500.0 / MALLET**2)  # Pa
    blows = {"corner": pulse(0.1, 0.01), "side": pulse(0.4, 0.01)}
    return [
        rf.Spring("rim", 330.0),
        rf.StiffnessDamping(ratio=0.3, frequency=20.0),
        rf.InitialVelocity(linear=(0, 0, 0.05)),
        *(rf.Traction(name, pressure, time=time) for name, time in blows.items()),
    ]


def push(where: str, force: tuple[float, float, float], time: Callable[[float], float]) -> Effects:
    """The bar clamped and pushed [Pa]."""
    return [BASE, rf.Traction(where, force, time=time)]


def ground(path: Callable[[float], tuple[float, float, float]]) -> Effects:
    """The bar on a ground that moves."""
    return [rf.PrescribedMotion("x0", displacement=path)]


def twisted(t: float) -> float:
    """A torque's rise and end."""
    return pulse(2.0, 6.0)(t)


CASES = {
    "gong": Gong(struck, tol=0.03, dt=2e-3, t_end=0.6),
    "sine on a block": Case(lambda: push("x1", (0, 0, 200.0), sine(4.0))),
    "shaken base": Case(lambda: ground(swinging(3.0, 0.05))),
    "slow sine": Case(lambda: push("x1", (0, 0, 200.0), sine(12.0))),
    "accelerogram": Case(lambda: ground(shake)),
    "turning gravity": Case(lambda: [BASE, rf.Gravity(turning)]),
    "wave into a half": Case(
        lambda: push("x1", (-3000.0, 0, 0), pulse(1.0, 0.2)), block=False, dt=0.01, t_end=4.0,
        tol=0.005, damping=0.1,
    ),
    "sine, resonance of the whole": Case(lambda: push("x1", (0, 0, 20.0), sine(9.6)), t_end=40.0),
    "sine, resonance of the block": Case(
        lambda: push("x1", (0, 0, 400.0), sine(0.24)), dt=0.01, t_end=8.0
    ),
    "local sine on a damped bar": Case(
        lambda: [BASE, rf.NodalForce("x1", (0, 0, 100.0), time=sine(2.0)), rf.KelvinVoigt(2e4)],
        block=False, damping=3.0, tol=0.03,
    ),
    "lateral pulse off centre": Case(
        lambda: push("y1", (0, 0, 400.0), pulse(3.0, 0.3)), damping=2.0
    ),
    "spin-up": Case(
        lambda: [
            rf.Traction("y1", (-30.0, 0, 0), time=twisted),
            rf.Traction("y0", (30.0, 0, 0), time=twisted),
            rf.KelvinVoigt(2e4),
        ],
        damping=0.0,
    ),
}  # fmt: skip


def seconds(name: str) -> float:
    """Time that PETSc has logged for a part of the program [s]."""
    return float(PETSc.Log.Event(name).getPerfInfo()["time"])


def peak_rate(case: Case, across: int) -> float:
    """Largest strain rate of the flexible run [1/s]."""
    nothing = rf.StrainRate(0.0, 1e9)
    run = rf.simulate(case.scene(across), case.dt, case.t_end, rigidify=nothing, progress=False)
    return max(float(report.strain_rate.max()) for report in run)


def judged(
    rates: np.ndarray, rigid: np.ndarray, ours: list[rf.Report], tol: float
) -> dict[str, float | int]:
    """Shares of cell-windows and of woken cells.

    Args:
        rates: Strain rates of the twin, shape (steps, cells) [1/s].
        rigid: Which cells were rigid at the end of each step, of the same shape.
        ours: Reports of the run with rigid parts.
        tol: Tolerance [1/s].
    """
    steps, cells = rates.shape
    quiet = needed = missed = woken = false = 0
    for first in range(0, steps - WINDOW + 1, WINDOW):
        window = rates[first : first + WINDOW]
        quiet += int((window <= tol).all(axis=0).sum())
        crossing = window > 2 * KAPPA * tol
        for cell in np.flatnonzero(crossing.any(axis=0)):
            at = first + int(np.argmax(crossing[:, cell]))
            needed += 1
            missed += bool(rigid[at, cell] and rigid[min(at + 1, steps - 1), cell])
    for step, report in enumerate(ours):
        for event in report.events:
            ahead = rates[step : step + 2 * WINDOW]
            woken += event.woken.size
            false += int((ahead[:, event.woken] <= tol).all(axis=0).sum())
    return {
        "needed": needed,
        "missed": missed / max(needed, 1),
        "woken": woken,
        "false": false / max(woken, 1),
        "rigid_share": float(rigid.mean()),
        "quiet_share": quiet / (steps // WINDOW * cells),
    }


def measure(name: str, across: int) -> dict[str, object]:
    """Both runs of a case."""
    case = CASES[name]
    peak = peak_rate(case, across)
    tol = case.tol * peak
    rule = rf.StrainRate(tol, WINDOW * case.dt, wake="local", kappa=KAPPA)
    before = seconds("rigidfxShadow"), seconds("rigidfxShadowNew")
    runs = {
        key: rf.simulate(case.scene(across), case.dt, case.t_end, rigidify=r, progress=False)
        for key, r in (("twin", rf.StrainRate(0.0, 1e9)), ("local", rule))
    }
    with Turns(runs, warm=1) as turns:
        rates, rigid = [], []
        for _ in range(round(case.t_end / case.dt)):
            turns.take()
            now = {key: reports[-1] for key, reports in turns.reports.items()}
            rates.append(now["twin"].strain_rate.copy())
            rigid.append(now["local"].state.body_numbers() > 0)
    twin, ours = turns.reports["twin"], turns.reports["local"]
    tips = [np.array([report.probes["tip"] for report in run]) for run in (ours, twin)]
    energies = [np.array([report.energy for report in run]) for run in (ours, twin)]
    wall = {key: sum(times) for key, times in turns.seconds.items()}
    looking, regrouping = seconds("rigidfxShadow"), seconds("rigidfxShadowNew")
    return {
        "scene": name,
        "unknowns": twin[-1].unknowns,
        "tol_over_peak": case.tol,
        **judged(np.array(rates), np.array(rigid), ours, tol),
        "error": float(np.abs(tips[0] - tips[1]).max() / np.abs(tips[1] - tips[1][0]).max()),
        "energy_error": float(np.abs(energies[0] - energies[1]).max() / energies[1].max()),
        "time_ratio": wall["local"] / wall["twin"],
        "prediction_share": (looking - before[0]) / wall["local"],
        "shadow_factor_share": (regrouping - before[1]) / wall["local"],
        "repeats": sum(event.reason == CHECKED for report in ours for event in report.events),
        "events": sum(len(report.events) for report in ours),
    }


def main() -> None:
    """Run the comparison and write its summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="600 unknowns")
    parser.add_argument("--across", type=int, default=4, help="cells across a bar")
    parser.add_only("scenes")
    options = parser.read(across=2)
    PETSc.Log.begin()
    summary = []
    for name in chosen(options, CASES):
        summary.append(measure(name, options.across))
        print(summary[-1])
    conclude(options.out, summary)
    assert all(entry["missed"] <= 0.01 for entry in summary)


if __name__ == "__main__":
    main()
