"""Problems of statics in which first-order cells lock, with answers known from literature.

R.H. MacNeal and R.L. Harder, Finite Elements in Analysis and Design 1 (1985) 3; K.Y. Sze, X.H. Liu
and S.H. Lo, Finite Elements in Analysis and Design 40 (2004) 1551.
"""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from common import block_of
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
