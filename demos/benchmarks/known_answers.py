"""Statics, modes and elements against theory, the literature and converged values.

* *statics*: bending, pressure, contact, friction, snap-through (`bench/static_answers.py`).
* *modes*: bars, a plate, a tuning fork, a string; and the time for six modes of 200 000 unknowns
  (`bench/mode_answers.py`).
* *locking*: problems in which first-order cells lock, with standard, enhanced and assumed strains,
  and with second-order cells (R.H. MacNeal and R.L. Harder, Finite
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
from contextlib import closing
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt
from bench import DT, MATERIAL, PUSH, Parser, Turns, bar, cells_of_bar, chosen, conclude
from bench.mode_answers import CASES as MODES
from bench.static_answers import CASES as STATICS
from common import block_of, say
from dolfinx import fem

import rigidfx as rf
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.linear_forms import static_forces

Array = npt.NDArray[np.float64]

ELEMENTS = {"standard": 1, "enhanced": 1, "assumed": 1, "second order": 2}  # and their orders
SOLID = "standard", "enhanced", "second order"
PROMISED = "enhanced", "assumed"  # elements whose errors are bounded
OUTSIDE = "outside"  # facets of one side of a thin part
SMALL = 1e-6  # of a load, in linear problems


@dataclass(frozen=True)
class Case:
    """A problem of statics with a known answer."""

    name: str  # its name
    mesh: tuple[int, int, int]  # cells along each axis
    reference: float | None  # the answer [m]; None if second-order cells give it
    value: Callable[[str], float]  # the computed one, of an element
    elements: tuple[str, ...] = tuple(ELEMENTS)  # elements that solve it


def mapped(n: tuple[int, int, int], place: Callable[..., Any]) -> rf.Domain:
    """A unit cube of n cells, brought into another shape by a function of three coordinates."""
    return block_of(n, lambda x: np.stack(np.broadcast_arrays(*place(*x))))


def options_of(element: str) -> dict[str, Any]:
    """Options of a scene with an element."""
    kinds = {"enhanced": "enhanced", "assumed": rf.AssumedStrains(OUTSIDE)}
    return {"order": ELEMENTS[element], "element": kinds.get(element, "standard")}


@dataclass(frozen=True)
class Problem:
    """A body under loads, to be solved with each element."""

    domain: rf.Domain  # the body
    E: float  # Young's modulus [Pa]
    nu: float  # Poisson's ratio
    # supports and loads; loads of a unit size in linear problems
    effects: tuple[rf.effects.Effect, ...]
    steps: int = 0  # load steps; 0 for a linear problem

    def scene(self, element: str) -> rf.Scene:
        """The problem with an element."""
        material = rf.StVenantKirchhoff(E=self.E, nu=self.nu, rho=1.0)
        return rf.Scene(self.domain, material, self.effects, **options_of(element))

    def solved(self, element: str) -> tuple[Array, Array]:
        """Positions and displacements of the nodes, shape (nodes, 3) [m]; on one rank."""
        steps = self.steps or [SMALL, 1.0]  # in a linear problem the first one is enough
        with closing(rf.static(self.scene(element), steps)) as reports:
            next(reports)
            for report in reports:
                u = report.state.u.x.array.reshape(-1, 3).copy()
                X = report.state.X.copy()
                if not self.steps:
                    return X, u / SMALL
        return X, u

    def mean(self, element: str, axis: int, at: Callable[[Array], Array]) -> float:
        """Mean displacement along an axis of the nodes that fulfil a condition on X [m]."""
        X, u = self.solved(element)
        return float(u[at(X), axis].mean())


def near(x: Array, value: float) -> Array:
    """Whether coordinates are a value."""
    return np.abs(x - value) < 1e-8 * (1 + abs(value))


def box(size: tuple[float, float, float], n: tuple[int, int, int]) -> rf.Domain:
    """With named faces x0 … z1, the last of which is the outside, too."""
    return rf.box((0, 0, 0), size, n).with_facets(OUTSIDE, lambda x: near(x[2], size[2]))


CLAMP = rf.Fixed("x0")


def cantilever(axis: int) -> Callable[[str], float]:
    """MacNeal and Harder's straight beam of six cells: 6 × 0.2 × 0.1, under 1 at its tip."""
    load = rf.Traction("x1", tuple(np.eye(3)[axis] / (0.2 * 0.1)))
    problem = Problem(box((6, 0.2, 0.1), (6, 1, 1)), 1e7, 0.3, (CLAMP, load))
    return lambda element: problem.mean(element, axis, lambda X: near(X[:, 0], 6.0))


def plate(slenderness: float, n: int) -> Callable[[str], float]:
    """A clamped square plate under 1 Pa, a quarter of it; its middle, over q a⁴/D."""
    t = 1 / slenderness
    symmetric = rf.Fixed("x0", "x"), rf.Fixed("y0", "y")
    effects = *symmetric, rf.Fixed("x1"), rf.Fixed("y1"), rf.Traction("z1", (0, 0, 1.0))
    problem = Problem(box((0.5, 0.5, t), (n, n, 1)), 1e7, 0.3, effects)
    over = 1e7 * t**3 / (12 * (1 - 0.3**2))
    middle = lambda X: near(X[:, 0], 0.0) & near(X[:, 1], 0.0)  # noqa: E731
    return lambda element: problem.mean(element, 2, middle) * over


def cook(n: int) -> Callable[[str], float]:
    """Cook's membrane in plane stress, half of its thickness; its free edge at (48, 52)."""
    membrane = mapped((n, n, 1), lambda a, b, c: (48 * a, 44 * (a + b) - 28 * a * b, 0.5 * c))
    effects = rf.Fixed("x0", "xy"), rf.Fixed("z0", "z"), rf.Traction("x1", (0, 1 / 16, 0))
    problem = Problem(membrane, 1.0, 1 / 3, effects)
    edge = lambda X: near(X[:, 0], 48.0) & near(X[:, 1], 52.0)  # noqa: E731
    return lambda element: problem.mean(element, 1, edge)


def large_deflection(axis: int) -> Callable[[str], float]:
    """A cantilever of 10 × 1 × 0.1 m under 4 N at its end (Sze, Liu and Lo 2004)."""
    load = rf.Traction("x1", (0, 0, 4 / 0.1))
    problem = Problem(box((10, 1, 0.1), (16, 1, 1)), 1.2e6, 0.0, (CLAMP, load), 20)
    return lambda element: abs(problem.mean(element, axis, lambda X: near(X[:, 0], 10.0)))


def roll_up(n: int) -> Callable[[str], float]:
    """A strip of 12 × 1 × 0.1 m rolled up by 2πEI/L at its end: how far that goes back."""
    moment = 2 * np.pi * 1.2e6 * 0.1**3 / 12 / 12.0
    load = rf.Resultant(rf.MeanFace("x1"), torque=(0, -moment, 0))
    problem = Problem(box((12, 1, 0.1), (n, 1, 1)), 1.2e6, 0.0, (CLAMP, load), 40)
    return lambda element: -problem.mean(element, 0, lambda X: near(X[:, 0], 12.0))


def incompressible(n: int) -> Callable[[str], float]:
    """A cube of ν = 0.4999 on its bottom, pressed on a quarter of its top: how far that gives."""
    corner = box((1, 1, 1), (n, n, n)).with_facets(
        "pressed", lambda x: near(x[2], 1.0) & (x[0] < 0.5 + 1e-8) & (x[1] < 0.5 + 1e-8)
    )
    effects = rf.Fixed("z0"), rf.Traction("pressed", (0, 0, -1.0))
    problem = Problem(corner, 1.0, 0.4999, effects)

    def value(element: str) -> float:
        weights = problem.scene(element).facet_weights("pressed", "benchmark")
        return -float(np.average(problem.solved(element)[1][:, 2], weights=weights))

    return value


def squeezed(element: str, stretch: float, confined: bool, n: int = 4) -> float:
    """Lowest eigenvalue of a compressed cube with held top and bottom, over the one at rest.

    Confined, the whole of its surface is held.
    """
    scene = Problem(box((1, 1, 1), (n, n, n)), 1.0, 0.3, ()).scene(element)
    forces = InternalForces(scene, fem.Function(scene.space))
    bound = static_forces(scene, forces, forces.cells())
    X = scene.space.tabulate_dof_coordinates()
    outside = near(X, 0.0) | near(X, 1.0)
    free = np.flatnonzero(np.repeat(~(outside.any(axis=1) if confined else outside[:, 2]), 3))

    def softest(compression: float) -> float:
        u = np.zeros(X.shape)
        u[:, 2] = -compression * X[:, 2]
        forces.u1.x.array[:] = u.reshape(-1)
        K = fem.assemble_matrix(bound.interior).to_scipy().tocsr()[free][:, free].toarray()
        return float(np.linalg.eigvalsh((K + K.T) / 2)[0])

    return softest(1 - stretch) / softest(0.0)


def _hemisphere(n: int, force: float, steps: int) -> tuple[Problem, list[Callable]]:
    """A quarter with a hole of 18°, R = 10, t = 0.04, pulled at A (x axis) and B; which nodes."""
    t = 0.04

    def place(a: Array, b: Array, c: Array) -> tuple[Array, Array, Array]:
        phi, theta, r = a * np.pi / 2, b * np.radians(72.0), 10 + t * (c - 0.5)
        flat = r * np.cos(theta)
        return flat * np.cos(phi), flat * np.sin(phi), r * np.sin(theta)

    at = [lambda X, k=k: near(X[:, k], 0.0) & near(X[:, 2], 0.0) for k in (1, 0)]
    domain = mapped((n, n, 1), place)
    domain = domain.with_facets(OUTSIDE, lambda x: np.linalg.norm(x, axis=0) > 10 + 0.4 * t)
    for name, nodes in zip("AB", at, strict=True):
        domain = domain.with_vertices(name, lambda x, nodes=nodes: nodes(x.T))
    domain = domain.with_vertices(
        "one", lambda x: at[0](x.T) & (np.linalg.norm(x, axis=0) < 10 - 0.4 * t)
    )
    held = rf.Fixed("x1", "x"), rf.Fixed("x0", "y"), rf.Fixed("one", "z")
    pulled = rf.NodalForce("A", (-force, 0, 0)), rf.NodalForce("B", (0, force, 0))
    return Problem(domain, 6.825e7, 0.3, (*held, *pulled), steps), at


def hemisphere(n: int) -> Callable[[str], float]:
    """Pinched by 1 N: how far A goes in."""
    problem, (A, _) = _hemisphere(n, 1.0, 0)
    return lambda element: -problem.mean(element, 0, A)


def pinched(n: int, which: int) -> Callable[[str], float]:
    """How far A goes in or B out under 400 N, half of it on a quarter (Sze, Liu and Lo 2004)."""
    problem, at = _hemisphere(n, 200.0, 15)
    return lambda element: abs(problem.mean(element, which, at[which]))


def _vault(n: int, angle: float, R: float, half: float, t: float) -> rf.Domain:
    """Part of a tube about the y axis, from its top (x0) to an angle (x1), half of its length."""

    def place(a: Array, b: Array, c: Array) -> tuple[Array, Array, Array]:
        r = R + t * (c - 0.5)
        return r * np.sin(angle * a), half * b, r * np.cos(angle * a)

    domain = mapped((n, n, 1), place)
    return domain.with_facets(OUTSIDE, lambda x: np.hypot(x[0], x[2]) > R + 0.4 * t)


def roof(n: int) -> Callable[[str], float]:
    """Scordelis and Lo's: R = 25, 50 long, t = 0.25, ±40°, on stiff walls; its edge's middle."""
    angle = np.radians(40)
    held = rf.Fixed("x0", "x"), rf.Fixed("y0", "xz"), rf.Fixed("y1", "y")
    weight = rf.Gravity((0, 0, -90 / 0.25))
    problem = Problem(_vault(n, angle, 25.0, 25.0, 0.25), 4.32e8, 0.0, (*held, weight))
    edge = lambda X: near(np.arctan2(X[:, 0], X[:, 2]), angle) & near(X[:, 1], 25.0)  # noqa: E731
    return lambda element: -problem.mean(element, 2, edge)


def cylinder(n: int) -> Callable[[str], float]:
    """Pinched by 1 at its middle: R = 300, 600 long, t = 3, between stiff walls; an eighth."""
    top = lambda X: near(X[:, 0], 0.0) & near(X[:, 1], 300.0)  # noqa: E731
    domain = _vault(n, np.pi / 2, 300.0, 300.0, 3.0).with_vertices("top", lambda x: top(x.T))
    held = rf.Fixed("x0", "x"), rf.Fixed("y0", "xz"), rf.Fixed("y1", "y"), rf.Fixed("x1", "z")
    problem = Problem(domain, 3e6, 0.3, (*held, rf.NodalForce("top", (0, 0, -0.25))))
    return lambda element: -problem.mean(element, 2, top)


PLATES = (10, None), (100, 0.00126532), (1000, 0.00126532)  # a/t, and the middle's w D/(q a⁴)


def cases(short: bool) -> list[Case]:
    """All, or those that take seconds."""
    large = PROMISED if short else tuple(ELEMENTS)  # standard cells take longest
    some = [
        Case("cantilever, out of plane", (6, 1, 1), 0.4321, cantilever(2)),
        *(Case(f"clamped plate, a/t {k}", (8, 8, 1), w, plate(k, 8)) for k, w in PLATES),
        Case("pinched hemisphere", (8, 8, 1), 0.0930, hemisphere(8)),
        Case("Cook's membrane", (8, 8, 1), 23.96, cook(8), SOLID),
        Case("cantilever under 4 N, down", (16, 1, 1), 6.698, large_deflection(2), large),
    ]
    if short:
        return some
    return [
        *some,
        Case("cantilever, in plane", (6, 1, 1), 0.1081, cantilever(1)),
        Case("pinched hemisphere", (16, 16, 1), 0.0930, hemisphere(16)),
        Case("roof under its weight", (8, 8, 1), 0.3024, roof(8)),
        Case("nearly incompressible block", (4, 4, 4), None, incompressible(4), SOLID),
        *(Case(f"clamped plate, a/t {k}", (16, 16, 1), w, plate(k, 16)) for k, w in PLATES),
        Case("roof under its weight", (16, 16, 1), 0.3024, roof(16)),
        *(Case("pinched cylinder", (n, n, 1), 1.8248e-5, cylinder(n)) for n in (16, 32)),
        Case("Cook's membrane", (16, 16, 1), 23.96, cook(16), SOLID),
        Case("cantilever under 4 N, back", (16, 1, 1), 3.286, large_deflection(0)),
        Case("strip rolled up", (24, 1, 1), 12.0, roll_up(24), PROMISED),
        Case("hemisphere under 400 N, in", (16, 16, 1), 8.178, pinched(16, 0), PROMISED),
        Case("hemisphere under 400 N, out", (16, 16, 1), 4.067, pinched(16, 1), PROMISED),
        Case("hemisphere under 400 N, in", (24, 24, 1), 8.178, pinched(24, 0), PROMISED),
        Case("hemisphere under 400 N, out", (24, 24, 1), 4.067, pinched(24, 1), PROMISED),
        Case("nearly incompressible block", (6, 6, 6), None, incompressible(6), SOLID),
    ]


# Relative errors allowed on meshes that are coarse on purpose.
TOLERANCES = {
    ("pinched hemisphere", "8x8x1", "enhanced"): 0.3,
    ("pinched cylinder", "16x16x1", "enhanced"): 0.1,
    ("pinched cylinder", "16x16x1", "assumed"): 0.08,
    **{
        (f"hemisphere under 400 N, {way}", mesh, element): most
        for way in ("in", "out")
        for mesh, most in (("16x16x1", 0.11), ("24x24x1", 0.05))
        for element in ("enhanced", "assumed")
    },
    ("nearly incompressible block", "4x4x4", "enhanced"): 0.05,
}


# Parts --------------------------------------------------------------------------------------------

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


PARTS = {part.__name__: part for part in (statics, modes, locking, cost, compressed)}


if __name__ == "__main__":
    parser = Parser(__file__, __doc__.splitlines()[0], short="coarse meshes, few cases")
    parser.add_argument("--unknowns", type=int, default=27_000, help="of the step in cost")
    parser.add_argument("--steps", type=int, default=7, help="timed steps")
    parser.add_only("parts")
    options = parser.read(unknowns=500, steps=1)
    warnings.simplefilter("ignore", rf.RigidfxWarning)  # standard cells lock on purpose
    conclude(options.out, {name: PARTS[name](options) for name in chosen(options, PARTS)})
