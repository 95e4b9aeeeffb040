"""Mechanisms against independent solutions: joints and motors on rigid and on flexible parts.

* *double pendulum*: against SciPy's DOP853 in angles.
* *bar on a pin*: a flexible steel bar of 1 m, let go from the horizontal on a pin in its own hole,
  against the period of a physical pendulum of its mesh's mass and inertia (1.93334 s if uniform).
* *slider-crank*: flexible crank and rod, driven by a torque; the balance of energy with the motor's
  work, and crank speed and deflection of the rod of both bars reduced, and of Exudyn's floating
  frames, beside those of this twin: a line for each.
* *rod, rigid and mean faces*: a connecting rod held by its two holes: stiffness [N/m, N m/rad] and
  frequencies between two pins [Hz], a line for each kind of face.

Mechanisms with published motions are among `known_problems.py`. The error is that of the end point
[m], of the bar's period [s], at the smaller Δt; the order is measured from two Δt.

Exudyn is a peer of the slider-crank, by its floating frames of reference with 64 modes a body, of
the mass and stiffness of the same mesh. It is optional, and said to be missing where it is not
there. Put it into an environment of its own,

    ./fenicsx python3 -m venv out/peers/exudyn
    ./fenicsx out/peers/exudyn/bin/python -m pip install exudyn scipy

or name the Python that has it by --exudyn. Then

    ./fenicsx python3 demos/benchmarks/mechanisms.py
"""

import importlib.util
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from bench import Parser, chosen, conclude
from bench.drilled import exact_period, rod_numbers, swing
from bench.flexible_crank import crank_motion, flexible_crank, for_exudyn, motion
from bench.followed import Followed
from bench.mechanism_scenes import hinged
from codes import Found, exudyn
from common import ROOT, say
from scipy.integrate import solve_ivp

import rigidfx as rf

Array = npt.NDArray[np.float64]
Row = dict[str, Any]
MODES = 64  # of each flexible body in Exudyn
SPEED, DEFLECTION = 0.005, 0.03  # largest difference to Exudyn, of the largest value


def line(case: str, run: Followed | None = None, **known: Any) -> Row:
    """A line of the summary; what is not known is None."""
    names = "unknowns", "energy_drift", "constraint", "error", "order", "seconds_per_step", "peer"
    of_run = {} if run is None else {
        "unknowns": run.last.unknowns, "energy_drift": run.drift, "constraint": run.gap,
        "seconds_per_step": run.seconds, "iterations": run.iterations,
    }  # fmt: skip
    return {"case": case} | dict.fromkeys(names) | of_run | known


@dataclass(frozen=True)
class Asked:
    """How the cases run."""

    short: bool  # longer steps, shorter
    # lets Exudyn run a mechanism; None if it is not there
    exudyn: Callable[[dict[str, Any]], Found] | None


def pendulum(asked: Asked) -> list[Row]:
    """Two thin bars: the tip after 2 s."""

    def motion(t: float, y: Array) -> Array:
        a, b, da, db = y
        c, s = np.cos(a - b), np.sin(a - b)
        mass = np.array([[4 / 3, c / 2], [c / 2, 1 / 3]])
        g = 9.81
        force = [-s / 2 * db**2 - 1.5 * g * np.cos(a), s / 2 * da**2 - 0.5 * g * np.cos(b)]
        return np.r_[da, db, np.linalg.solve(mass, force)]

    solution = solve_ivp(motion, (0, 2), np.zeros(4), "DOP853", rtol=1e-12, atol=1e-12)
    a, b = solution.y[:2, -1]
    exact = np.array([np.cos(a) + np.cos(b), np.sin(a) + np.sin(b), 0.0])
    steps = (0.008, 0.004) if asked.short else (0.002, 0.001)
    coarse, fine = (Followed(hinged(2), dt, 2.0) for dt in steps)
    ends = [run.place("bar 1", np.array([0.5, 0, 0])) for run in (coarse, fine)]
    off = [float(np.linalg.norm(end - exact)) for end in ends]
    order = float(np.log(off[0] / off[1]) / np.log(steps[0] / steps[1]))
    assert abs(order - 2) <= 0.3
    return [line("double pendulum", fine, error=off[1], order=order)]


def pin(asked: Asked) -> list[Row]:
    """A bar swings on a pin in its own hole."""
    size, steps = (0.03, (0.02, 0.01)) if asked.short else (0.02, (0.01, 0.005))
    exact = exact_period(size)
    (coarse, _), (period, run) = (swing(size, dt) for dt in steps)
    off = coarse - exact, period - exact
    assert abs(off[1]) <= 1e-3 * exact
    assert run.drift <= 1e-10
    found = {"error": abs(off[1]), "order": float(np.log2(abs(off[0] / off[1])))}
    return [line("bar on a pin", run, **found, period=period, exact_period=exact)]


def crank(asked: Asked) -> list[Row]:
    """A motor, a flexible crank, a flexible rod and a slider; the same with both bars reduced."""
    scene = flexible_crank(0.03)
    parts = [rf.Reduced(name) for name in ("crank", "rod")]
    dt, steps = 2e-4, 100 if asked.short else 200
    twin, flexible = crank_motion(scene, dt, steps)
    own, reduced = crank_motion(flexible_crank(0.03, *parts), dt, steps)
    rows = [line("slider-crank", flexible), line("slider-crank, reduced", reduced)]
    for run in (flexible, reduced):
        assert run.drift <= 1e-10
        assert run.gap <= 1e-12
    rows[1] |= apart(own, twin)
    assert rows[1]["speed_apart"] <= 1e-4
    assert rows[1]["deflection_apart"] <= 0.01
    if asked.exudyn is not None:
        shapes = max(body.shapes for body in reduced.last.bodies)
        for modes in (shapes + 6, MODES):
            found = asked.exudyn(for_exudyn(scene, dt, steps) | {"modes": modes})
            theirs = apart(motion(found["crank"], found["rod"], dt), twin)
            row = line(f"slider-crank, Exudyn, {modes} modes", peer=str(found["version"]))
            rows.append(row | {"seconds_per_step": float(found["seconds"])} | theirs)
        assert theirs["speed_apart"] <= SPEED
        assert theirs["deflection_apart"] <= DEFLECTION
    return rows


def apart(own: tuple[Array, Array], twin: tuple[Array, Array]) -> Row:
    """Largest differences to the twin's speed and deflection, of the largest value."""
    of = [float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(own, twin, strict=True)]
    return dict(zip(("speed_apart", "deflection_apart"), of, strict=True))


def rod(asked: Asked) -> list[Row]:
    """A rod between faces of each kind: the rigid ones are stiffer."""
    kinds = {"mean faces": rf.MeanFace, "rigid faces": rf.RigidFace}
    rows = {
        name: rod_numbers(face, 0.012 if asked.short else 0.008) for name, face in kinds.items()
    }
    mean, rigid = rows.values()
    assert all(rigid[key] > mean[key] for key in ("tension", "sideways", "torsion"))
    assert np.all(np.array(rigid["frequencies"]) > mean["frequencies"])
    return [line(f"rod, {name}", **row) for name, row in rows.items()]


CASES: dict[str, Callable[[Asked], list[Row]]] = {
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


if __name__ == "__main__":
    parser = Parser(__file__, "Mechanisms against independent solutions.", "longer steps, shorter")
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
