"""Problems of statics in which first-order cells lock, with answers known from literature."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

import rigidfx as rf
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.linear_forms import static_forces

from .graded import block_of

Array = npt.NDArray[np.float64]

ELEMENTS = {"standard": 1, "enhanced": 1, "assumed": 1, "second order": 2}  # and their orders
SOLID = "standard", "enhanced", "second order"
PROMISED = "enhanced", "assumed"  # elements whose errors are bounded
OUTSIDE = "outside"  # facets of one side of a thin part
SMALL = 1e-6  # of a load, in linear problems


@dataclass(frozen=True)
class Case:
    """A problem of statics with a known answer.

    Attributes:
        name: Its name.
        mesh: Cells along each axis.
        reference: The answer [m]; None if second-order cells give it.
        value: The computed one, of an element.
        elements: Elements that solve it.
    """

    name: str
    mesh: tuple[int, int, int]
    reference: float | None
    value: Callable[[str], float]
    elements: tuple[str, ...] = tuple(ELEMENTS)


def mapped(n: tuple[int, int, int], place: Callable[..., Any]) -> rf.Domain:
    """A unit cube of n cells, brought into another shape by a function of three coordinates."""
    return block_of(n, lambda x: np.stack(np.broadcast_arrays(*place(*x))))


def options_of(element: str) -> dict[str, Any]:
    """Options of a scene with an element."""
    kinds = {"enhanced": "enhanced", "assumed": rf.AssumedStrains(OUTSIDE)}
    return {"order": ELEMENTS[element], "element": kinds.get(element, "standard")}


@dataclass(frozen=True)
class Problem:
    """A body under loads, to be solved with each element.

    Attributes:
        domain: The body.
        E: Young's modulus [Pa].
        nu: Poisson's ratio.
        effects: Supports and loads; loads of a unit size in linear problems.
        steps: Load steps; 0 for a linear problem.
    """

    domain: rf.Domain
    E: float
    nu: float
    effects: tuple[rf.Effect, ...]
    steps: int = 0

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
