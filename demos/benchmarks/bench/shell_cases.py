"""Thin curved parts of one cell across in which first-order cells lock, with known answers.

R.H. MacNeal and R.L. Harder, Finite Elements in Analysis and Design 1 (1985) 3; K.Y. Sze, X.H. Liu
and S.H. Lo, Finite Elements in Analysis and Design 40 (2004) 1551.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import rigidfx as rf

from .locking_cases import OUTSIDE, Array, Problem, mapped, near


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
