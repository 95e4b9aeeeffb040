"""Mechanisms: joints, motors, redundancy, against published and independent solutions.

* *four-bar 2*, *four-bar 40*: N four-bar linkages (IFToMM's benchmark A02); the end point of N = 2
  after 10 s is (0.3284574, 0.9445188) m, and N = 40 has 120 redundant rows or more.
* *Bricard*: five bars along the edges of a cube (A04): one redundant row.
* *heavy top*: at 150 rad/s (O. Brüls, A. Cardona, M. Arnold, Mechanism and Machine Theory 48 (2012)
  121): x(2 s) = (-0.15042, -0.72417, -0.67302) m.
* *double pendulum*: against SciPy's DOP853 in angles.
* *bar on a pin*: a flexible steel bar of 1 m, let go from the horizontal on a pin in its own hole,
  against the period of a physical pendulum of its mesh's mass and inertia (1.93334 s if uniform).
* *slider-crank*: flexible crank and rod, driven by a torque; the balance of energy with the motor's
  work, and crank speed and deflection of the rod of both bars reduced, and of Exudyn's floating
  frames, beside those of this twin: a line for each.
* *rod, rigid and mean faces*: a connecting rod held by its two holes: stiffness [N/m, N m/rad] and
  frequencies between two pins [Hz], a line for each kind of face.

The error is that of the end point [m], of the bar's period [s], at the smaller Δt; the order is
measured from two Δt.

Exudyn is a peer of two cases: four-bar 2 in the plane by its generalised α, and the slider-crank by
its floating frames of reference with 64 modes a body, of the mass and stiffness of the same mesh.
It is optional, and said to be missing where it is not there. Put it into an environment of its own,

    ./fenicsx python3 -m venv out/peers/exudyn
    ./fenicsx out/peers/exudyn/bin/python -m pip install exudyn scipy

or name the Python that has it by --exudyn. Then

    ./fenicsx python3 demos/benchmarks/mechanisms.py
"""

from __future__ import annotations

import importlib.util
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt
from bench import Parser, chosen, conclude
from bench.flexible_crank import crank_motion, flexible_crank, for_exudyn, motion
from bench.hung_bar import exact_period, swing
from bench.mechanism_scenes import bricard, double_pendulum, four_bars, heavy_top
from bench.rod import rod_numbers
from codes import Found, exudyn
from common import ROOT, say
from scipy.integrate import solve_ivp

import rigidfx as rf

Array = npt.NDArray[np.float64]
Row = dict[str, Any]
MODES = 64  # of each flexible body in Exudyn
SPEED, DEFLECTION = 0.005, 0.03  # largest difference to Exudyn, of the largest value
# Parts, points of them in their frames at the start [m], and where these end [m].
UP, BAR = ("up 0", np.array([0.0, 0.5, 0.0])), ("bar 2", np.array([0.0, 0.0, 0.5]))
TOP = "top", np.zeros(3)
END_OF_UP, END_OF_TOP = np.array([0.3284574, 0.9445188]), np.array([-0.15042, -0.72417, -0.67302])


@dataclass(frozen=True)
class Asked:
    """How the cases run.

    Attributes:
        short: Longer steps, shorter.
        exudyn: Lets Exudyn run a mechanism; None if it is not there.
    """

    short: bool
    exudyn: Callable[[dict[str, Any]], Found] | None


class Followed:
    """A run: its drift of energy [J], constraints [m], end point and seconds a step."""

    def __init__(self, scene: rf.Scene, dt: float, t_end: float, end: tuple[str, Array]) -> None:
        """Run it.

        Args:
            scene: The mechanism.
            dt: Δt [s].
            t_end: Its end [s].
            end: Name of a rigid part, and a point of it in its frame at the start [m].
        """
        name, arm = end
        self.drift = self.gap = 0.0
        told: list[warnings.WarningMessage]
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            began, expected, steps = perf_counter(), 0.0, 0
            for report in rf.simulate(scene, dt, t_end):
                steps += 1
                if report.step == 0:
                    expected, began = report.energy, perf_counter()
                    continue
                expected += report.work_of_loads - sum(report.dissipated.values())
                self.drift = max(self.drift, abs(report.energy - expected))
                self.gap = max(self.gap, *(joint.gap for joint in report.joints.values()))
        self.unknowns = report.unknowns
        self.seconds = (perf_counter() - began) / max(steps - 1, 1)
        implied = [str(w.message) for w in told if "follow from others" in str(w.message)]
        self.redundant = int(implied[0].split()[0]) if implied else 0
        at = {body.data.name: body.motion for body in report.rigid}
        self.end = at[name].r + at[name].R @ arm

    def row(self, case: str, **more: Any) -> Row:
        """Its line of the summary."""
        out = {"case": case, "unknowns": self.unknowns, "energy_drift": self.drift}
        out |= {"constraint": self.gap, "error": None, "order": None, "redundant": self.redundant}
        out |= {"seconds_per_step": self.seconds, "peer": None, "peer_seconds_per_step": None}
        return out | more


def against(
    case: str,
    make: Callable[[], rf.Scene],
    steps: tuple[float, float],
    end: tuple[str, Array],
    exact: Array,
    t_end: float,
) -> list[Row]:
    """A mechanism at two Δt against a known end point."""
    coarse, fine = (Followed(make(), dt, t_end, end) for dt in steps)
    off = [float(np.linalg.norm((run.end - exact)[: exact.size])) for run in (coarse, fine)]
    order = float(np.log(off[0] / off[1]) / np.log(steps[0] / steps[1]))
    fine.drift, fine.gap = max(coarse.drift, fine.drift), max(coarse.gap, fine.gap)
    return [fine.row(case, error=off[1], order=order)]


def two(asked: Asked) -> list[Row]:
    """N = 2, its end point after 10 s."""
    steps = (0.02, 0.01) if asked.short else (0.01, 0.005)
    rows = against("four-bar 2", lambda: four_bars(2), steps, UP, END_OF_UP, 10.0)
    assert rows[0]["energy_drift"] <= 1e-10
    assert rows[0]["constraint"] <= 1e-11
    assert rows[0]["error"] <= 1e-2
    assert abs(rows[0]["order"] - 2) <= 0.3
    assert rows[0]["redundant"] == 6
    if asked.exudyn is not None:
        dt = min(steps)
        found = asked.exudyn({"kind": "four-bars", "n": 2, "dt": dt, "steps": round(10 / dt)})
        drift = float(np.abs(found["energy"] - found["energy"][0]).max())
        rows[0] |= peer_of(found) | {
            "peer_energy_drift": drift,
            "peer_error": float(np.linalg.norm(found["end"][:2] - END_OF_UP)),
        }
    return rows


def forty(asked: Asked) -> list[Row]:
    """N = 40: rows that others imply."""
    run = Followed(four_bars(40), 0.01, 0.2 if asked.short else 10.0, UP)
    assert run.drift <= 1e-9
    assert run.redundant == 120
    return [run.row("four-bar 40")]


def cube(asked: Asked) -> list[Row]:
    """Bricard's mechanism."""
    run = Followed(bricard(), 0.01, 1.0 if asked.short else 10.0, BAR)
    assert run.drift <= 1e-10
    assert run.redundant == 1
    return [run.row("Bricard")]


def top(asked: Asked) -> list[Row]:
    """The heavy top: its centre after 2 s."""
    steps = (0.002, 0.001) if asked.short else (0.001, 0.0005)
    rows = against("heavy top", heavy_top, steps, TOP, END_OF_TOP, 2.0)
    assert rows[0]["error"] <= 0.02
    return rows


def pendulum(asked: Asked) -> list[Row]:
    """Two thin bars: the tip after 2 s."""

    def motion(t: float, y: Array) -> Array:
        a, b, da, db = y
        c, s = np.cos(a - b), np.sin(a - b)
        mass = np.array([[4 / 3, c / 2], [c / 2, 1 / 3]])
        g = 9.81
        force = [-s / 2 * db**2 - 1.5 * g * np.cos(a), s / 2 * da**2 - 0.5 * g * np.cos(b)]
        return np.r_[da, db, np.linalg.solve(mass, force)]

    found = solve_ivp(motion, (0, 2), np.zeros(4), "DOP853", rtol=1e-12, atol=1e-12)
    a, b = found.y[:2, -1]
    exact = np.array([np.cos(a) + np.cos(b), np.sin(a) + np.sin(b), 0.0])
    steps = (0.004, 0.002) if asked.short else (0.002, 0.001)
    end = "lower", np.array([0.5, 0, 0])
    rows = against("double pendulum", double_pendulum, steps, end, exact, 2.0)
    assert abs(rows[0]["order"] - 2) <= 0.3
    return rows


def pin(asked: Asked) -> list[Row]:
    """A bar swings on a pin in its own hole."""
    size, steps = (0.03, (0.02, 0.01)) if asked.short else (0.02, (0.01, 0.005))
    exact = exact_period(size)
    coarse, (period, drift, gap, seconds, unknowns) = (swing(size, dt) for dt in steps)
    off = coarse[0] - exact, period - exact
    row: Row = {"case": "bar on a pin", "unknowns": unknowns, "energy_drift": drift}
    row |= {"constraint": gap, "error": abs(off[1]), "order": float(np.log2(abs(off[0] / off[1])))}
    row |= {"redundant": 0, "seconds_per_step": seconds, "peer": None}
    row |= {"peer_seconds_per_step": None, "period": period, "exact_period": exact}
    assert abs(off[1]) <= 1e-3 * exact
    assert drift <= 1e-10
    return [row]


def crank(asked: Asked) -> list[Row]:
    """A motor, a flexible crank, a flexible rod and a slider; the same with both bars reduced."""
    scene = flexible_crank(0.03)
    parts = [rf.Reduced(name) for name in ("crank", "rod")]
    dt, steps = 2e-4, 100 if asked.short else 200
    twin = crank_motion(scene, dt, steps)
    own = crank_motion(flexible_crank(0.03, *parts), dt, steps)
    rows = []
    for case, run in (("slider-crank", twin), ("slider-crank, reduced", own)):
        row: Row = {"case": case, "unknowns": run.unknowns, "energy_drift": run.drift}
        row |= {"constraint": run.gap, "error": None, "order": None, "redundant": 0}
        row |= {"seconds_per_step": run.seconds, "peer": None, "peer_seconds_per_step": None}
        rows.append(row | {"iterations": run.iterations})
        assert run.drift <= 1e-10
        assert run.gap <= 1e-12
    rows[1] |= apart(own.motion, twin.motion)
    assert rows[1]["speed_apart"] <= 1e-4
    assert rows[1]["deflection_apart"] <= 0.01
    if asked.exudyn is not None:
        for modes in (own.shapes + 6, MODES):
            found = asked.exudyn(for_exudyn(scene, dt, steps) | {"modes": modes})
            theirs = apart(motion(found["crank"], found["rod"], dt), twin.motion)
            row = dict.fromkeys(rows[0]) | {"case": f"slider-crank, Exudyn, {modes} modes"}
            row |= {"seconds_per_step": float(found["seconds"]), "peer": str(found["version"])}
            rows.append(row | theirs)
        assert theirs["speed_apart"] <= SPEED
        assert theirs["deflection_apart"] <= DEFLECTION
    return rows


def apart(own: tuple[Array, Array], twin: tuple[Array, Array]) -> Row:
    """Largest differences to the twin's speed and deflection, of the largest value."""
    of = [float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(own, twin, strict=True)]
    return dict(zip(("speed_apart", "deflection_apart"), of, strict=True))


def peer_of(found: Found) -> Row:
    """Exudyn's version and seconds a step."""
    return {"peer": str(found["version"]), "peer_seconds_per_step": float(found["seconds"])}


def rod(asked: Asked) -> list[Row]:
    """A rod between faces of each kind: the rigid ones are stiffer."""
    kinds = {"mean faces": rf.MeanFace, "rigid faces": rf.RigidFace}
    rows = {
        name: rod_numbers(face, 0.012 if asked.short else 0.008) for name, face in kinds.items()
    }
    mean, rigid = rows.values()
    assert all(rigid[key] > mean[key] for key in ("tension", "sideways", "torsion"))
    assert np.all(np.array(rigid["frequencies"]) > mean["frequencies"])
    none = dict.fromkeys(
        ("energy_drift", "constraint", "error", "order", "seconds_per_step"), None
    ) | {"redundant": 0, "peer": None, "peer_seconds_per_step": None}
    return [{"case": f"rod, {name}"} | none | row for name, row in rows.items()]


CASES: dict[str, Callable[[Asked], list[Row]]] = {
    "four-bar 2": two,
    "four-bar 40": forty,
    "Bricard": cube,
    "heavy top": top,
    "double pendulum": pendulum,
    "bar on a pin": pin,
    "slider-crank": crank,
    "rod, rigid and mean faces": rod,
}


def python_with_exudyn(named: str | None) -> str | None:
    """Path of a Python that has Exudyn: the one named, that of the docstring, or this one."""
    if named is not None:
        return named
    of_docstring = ROOT / "out" / "peers" / "exudyn" / "bin" / "python"
    if of_docstring.exists():
        return str(of_docstring)
    return sys.executable if importlib.util.find_spec("exudyn") else None


def main() -> None:
    """Run the cases and leave summary.json."""
    parser = Parser(__file__, "Mechanisms against published solutions.", "longer steps, shorter")
    parser.add_only("cases")
    parser.add_argument("--exudyn", help="Exudyn: path of the Python that has it")
    options = parser.read()
    if options.exudyn and not Path(options.exudyn).is_file():
        parser.error(f"--exudyn must be the path of a program, got {options.exudyn}")
    python = python_with_exudyn(options.exudyn)
    if python is None:
        say("Exudyn is missing: see the docstring, or name the Python that has it by --exudyn")
    peer = partial(exudyn, python, options.out / "exudyn") if python else None
    asked = Asked(options.short, peer)
    conclude(options.out, [row for name in chosen(options, CASES) for row in CASES[name](asked)])


if __name__ == "__main__":
    main()
