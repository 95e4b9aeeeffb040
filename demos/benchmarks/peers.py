"""The same mesh, loads and Δt with rigidfx, plain DOLFINx, CalculiX and Kratos.

A soft free body, Simo and Tarnow's L of first-order hexahedra, and a bracket of steel on a wall, of
second-order tetrahedra. All nodes move (no rigid parts), each code runs on one core, and with the
better of its linear solvers where it has two for such a case. rigidfx and plain DOLFINx integrate
by the energy-momentum method, the L with lumped masses, and solve to rounding; CalculiX and Kratos
by Newmark's (α = 0), with consistent masses, and to 1e-6 of the residual. After some time nothing
acts: `energy_drift` is the largest change of the energy from then on, relative, None if a run does
not get there. A run `survives` if it gets to its end with a drift below a tenth.

CalculiX and Kratos are optional. ./fenicsx does not install them, and its folder does not see the
system's own programs, so put both into a folder of yours. With Debian's packages (apt-get and dpkg
of Debian or Ubuntu):

    mkdir -p out/peers && cd out/peers
    apt-get download calculix-ccx libspooles2.2 libarpack2
    for package in *.deb; do dpkg -x $package ccx; done
    cd ../..
    ./fenicsx python3 -m venv out/peers/kratos
    ./fenicsx out/peers/kratos/bin/python -m pip install KratosLinearSolversApplication \\
        KratosStructuralMechanicsApplication

Then

    ./fenicsx python3 demos/benchmarks/peers.py

finds them there; --ccx and --kratos name other places. A code that is not there is said to be
missing, and is not in `summary.json`: a list with code, case, unknowns, seconds_per_step (median),
newton (mean of the steps), energy_drift and survives.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import mean, median

import numpy as np
from bench import Parser, conclude
from codes import (
    Case,
    Outcome,
    calculix,
    calculix_there,
    kratos,
    metal_bracket,
    plain_dolfinx,
    rigidfx,
    soft_l,
)
from common import ROOT, say

SURVIVES = 0.1  # largest drift
HERE = ROOT / "out" / "peers"  # where the docstring puts the others


def codes(ccx: str | None, python: str | None, out: Path) -> dict[str, Callable[[Case], Outcome]]:
    """What is there, by name; what is not is said."""
    found: dict[str, Callable[[Case], Outcome]] = {
        "rigidfx": rigidfx,
        "plain DOLFINx": plain_dolfinx,
    }
    ccx = calculix_there(ccx)
    unpacked = HERE / "kratos/bin/python"
    python = python or (str(unpacked) if unpacked.exists() else None)
    if ccx:
        found["CalculiX"] = partial(calculix, command=ccx, folder=out / "calculix")
    if python:
        found["Kratos"] = partial(kratos, python=python, folder=out / "kratos")
    for name, option, there in (("CalculiX", "--ccx", ccx), ("Kratos", "--kratos", python)):
        if not there:
            say(f"{name} is missing: see the docstring, or name it by {option}")
    return found


def row(name: str, case: Case, outcome: Outcome, reference: Outcome) -> dict[str, object]:
    """The numbers of a code and a case."""
    drift = outcome.drift(case)
    apart = None
    if outcome.probe is not None and not outcome.failed:
        path = np.linalg.norm(reference.probe - case.nodes[case.probe])
        apart = float(np.linalg.norm(outcome.probe - reference.probe) / path)
    return {
        "code": name,
        "case": case.name,
        "unknowns": case.unknowns,
        "seconds_per_step": median(outcome.seconds) if outcome.seconds else None,
        "newton": mean(outcome.newton) if outcome.newton else None,
        "energy_drift": drift,
        "survives": not outcome.failed and drift is not None and drift < SURVIVES,
        "steps": len(outcome.times),
        "solver": outcome.solver,
        "probe_apart": apart,
        "failed": outcome.failed,
    }


if __name__ == "__main__":
    parser = Parser(__file__, __doc__.splitlines()[0], short="700 and 2000 unknowns")
    parser.add_argument("--ccx", help="CalculiX: path of its program")
    parser.add_argument("--kratos", help="Kratos: path of the Python that has it")
    options = parser.read()
    for option in ("ccx", "kratos"):
        path = getattr(options, option)
        if path and not Path(path).is_file():
            parser.error(f"--{option} must be the path of a program, got {path}")
    if options.short:
        cases = [soft_l(1, 30, dt=0.2), metal_bracket(0.03, 24)]
    else:
        cases = [soft_l(1, 400), soft_l(2, 100), soft_l(4, 60), metal_bracket(0.009, 60)]
    summary = []
    for case in cases:
        outcomes = {}
        for name, run in codes(options.ccx, options.kratos, options.out).items():
            outcomes[name] = run(case)
            summary.append(row(name, case, outcomes[name], outcomes["rigidfx"]))
            say(str(summary[-1]))
    conclude(options.out, summary)
    ours = [each for each in summary if each["code"] == "rigidfx"]
    assert all(each["survives"] and each["energy_drift"] < 1e-8 for each in ours)
