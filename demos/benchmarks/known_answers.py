"""Statics, modes and elements against theory, the literature and converged values.

* *statics*: bending, pressure, contact, friction, snap-through (`bench/static_answers.py`).
* *modes*: bars, a plate, a tuning fork, a string; and the time for six modes of 200 000 unknowns
  (`bench/mode_answers.py`).
* *locking*: problems in which first-order cells lock, with standard, enhanced and assumed strains,
  and with second-order cells (`bench/locking_cases.py`; R.H. MacNeal and R.L. Harder, Finite
  Elements in Analysis and Design 1 (1985) 3; K.Y. Sze, X.H. Liu and S.H. Lo, Finite Elements in
  Analysis and Design 40 (2004) 1551). Without a known answer second-order cells give it.
* *cost*: a step of a bar with enhanced cells over one with standard cells, in turn.
* *compressed*: lowest eigenvalues of a block that is squeezed.

Rows of `summary.json` have the value, the reference and the relative error.

    ./fenicsx python3 demos/benchmarks/known_answers.py --only statics
"""

import warnings
from argparse import Namespace
from collections.abc import Callable
from time import perf_counter
from typing import Any

from bench import DT, MATERIAL, PUSH, Parser, Turns, bar, cells_of_bar, chosen, conclude
from bench.locking_cases import PROMISED, TOLERANCES, cases, options_of, squeezed
from bench.mode_answers import CASES as MODES
from bench.static_answers import CASES as STATICS
from common import block_of, say

import rigidfx as rf

STRETCHES = 0.9, 0.8, 0.7, 0.6
COARSE = 0.01  # relative error of modes that is allowed in a short run
USUAL = 0.03  # relative error of enhanced and assumed strains

Rows = list[dict[str, Any]]


def row_of(case: str, value: float, reference: float, allowed: float | None) -> dict[str, Any]:
    """A row; its error is below the allowed one, if there is one."""
    error = abs(value - reference) / abs(reference)
    row = {"case": case, "value": value, "reference": reference, "error": error}
    say(str(row))
    assert allowed is None or error < allowed, row
    return row


def statics(options: Namespace) -> Rows:
    """Static solutions."""
    return [row_of(name, *case(options.short), most) for name, (case, most) in STATICS.items()]


def modes(options: Namespace) -> Rows:
    """Frequencies, and in full runs seconds."""
    rows = []
    for case, most in MODES.values():
        if options.short and most is None:
            continue
        began = perf_counter()
        allowed = max(most, COARSE) if options.short else most
        rows += [row_of(*found, allowed) for found in case(options.short)]
        rows[-1]["seconds"] = perf_counter() - began
    return rows


def locking(options: Namespace) -> Rows:
    """Each case with each element."""
    rows = []
    for case in cases(options.short):
        found = {element: case.value(element) for element in case.elements}
        reference = found["second order"] if case.reference is None else case.reference
        mesh = "x".join(map(str, case.mesh))
        for element, value in found.items():
            own = TOLERANCES.get((case.name, mesh, element), USUAL)
            most = own if element in PROMISED else None
            row = row_of(f"{case.name}, {mesh}, {element}", value, reference, most)
            rows.append({**row, "normalised": value / reference})
    return rows


def pushed_bar(unknowns: int, element: str, tapered: bool) -> rf.Scene:
    """The bar of all benchmarks; tapered, none of its cells is a parallelepiped."""
    along, across = cells_of_bar(unknowns)
    domain = bar(along, across)
    if tapered:
        slopes = [[0.0], [0.2], [0.3]]
        size = [[along], [across], [across]]
        domain = block_of((along, across, across), lambda x: size * x * (1 - slopes * x[0]))
    return rf.Scene(domain, MATERIAL, [PUSH], **options_of(element))


def cost(options: Namespace) -> dict[str, Any]:
    """A step with enhanced cells over one with standard ones, of a bar and of a tapered one."""
    found: dict[str, Any] = {"unknowns": options.unknowns}
    for kind in ("", "_tapered"):
        runs = {
            e: rf.simulate(
                pushed_bar(options.unknowns, e, bool(kind)), DT, 1e6 * DT, progress=False
            )
            for e in ("enhanced", "standard")
        }
        with Turns(runs) as turns:
            for _ in range(options.steps):
                turns.take()
            found["cost_ratio_to_standard" + kind] = turns.ratio("enhanced", "standard")
            found["seconds" + kind] = {e: turns.median(e) for e in runs}
    return found


def compressed(options: Namespace) -> dict[str, Any]:
    """Stretches at which blocks lose their stability: a lowest eigenvalue below zero."""
    return {
        f"{e}, {'confined' if confined else 'free sides'}": {
            s: squeezed(e, s, confined, 2 if options.short else 4)
            for s in (STRETCHES[:1] if options.short else STRETCHES)
        }
        for e in ("enhanced", "standard")
        for confined in (False, True)
    }


PARTS: dict[str, Callable[[Namespace], Any]] = {
    "statics": statics,
    "modes": modes,
    "locking": locking,
    "cost": cost,
    "compressed": compressed,
}


def main() -> None:
    """Run the parts and write their summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="coarse meshes, few cases")
    parser.add_argument("--unknowns", type=int, default=27_000, help="of the step in cost")
    parser.add_argument("--steps", type=int, default=7, help="timed steps")
    parser.add_only("parts")
    options = parser.read(unknowns=500, steps=1)
    warnings.simplefilter("ignore", rf.RigidfxWarning)  # standard cells lock on purpose
    conclude(options.out, {name: PARTS[name](options) for name in chosen(options, PARTS)})


if __name__ == "__main__":
    main()
