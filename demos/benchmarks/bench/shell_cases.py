"""Thin curved parts of one cell across in which first-order cells lock, with known answers.

R.H. MacNeal and R.L. Harder, Finite Elements in Analysis and Design 1 (1985) 3; K.Y. Sze, X.H. Liu
and S.H. Lo, Finite Elements in Analysis and Design 40 (2004) 1551.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from .locking_cases import OUTSIDE, Array, mapped, near, scene_of
from .statics import Statics


def _hemisphere(n: int, element: str) -> tuple[Statics, Array, Array, Array]:
    """A quarter with a hole of 18°, R = 10, t = 0.04; nodes at A (x axis) and B, unit forces."""
    t = 0.04

    def place(a: Array, b: Array, c: Array) -> tuple[Array, Array, Array]:
        phi, theta, r = a * np.pi / 2, b * np.radians(72.0), 10 + t * (c - 0.5)
        flat = r * np.cos(theta)
        return flat * np.cos(phi), flat * np.sin(phi), r * np.sin(theta)

    domain = mapped((n, n, 1), place)
    domain = domain.with_facets(OUTSIDE, lambda x: np.linalg.norm(x, axis=0) > 10 + 0.4 * t)
    scene = scene_of(domain, element, 6.825e7, 0.3)

    def held(X: Array) -> Array:
        on_x, on_y = near(X[:, 1], 0.0), near(X[:, 0], 0.0)
        inside = np.linalg.norm(X, axis=1) < 10 - 0.4 * t
        one = on_x & near(X[:, 2], 0.0) & inside
        return np.stack([on_y, on_x, one], axis=1)

    statics = Statics(scene, held)
    X = statics.X
    A = near(X[:, 1], 0.0) & near(X[:, 2], 0.0)
    B = near(X[:, 0], 0.0) & near(X[:, 2], 0.0)
    f = np.zeros(X.shape)
    f[A, 0], f[B, 1] = -1 / A.sum(), 1 / B.sum()
    return statics, A, B, f


def hemisphere(n: int) -> Callable[[str], float]:
    """Pinched by 1 N: how far A goes in."""

    def value(element: str) -> float:
        statics, A, _, f = _hemisphere(n, element)
        return -float(statics.linear(f)[A, 0].mean())

    return value


@cache
def _pinched(n: int, element: str) -> tuple[float, float]:
    """How far A goes in and B out under 400 N, half of it on a quarter (Sze, Liu and Lo 2004)."""
    statics, A, B, f = _hemisphere(n, element)
    u = statics.loaded(lambda u, s: (200 * s * f.reshape(-1), None), 15)
    return -float(u[A, 0].mean()), float(u[B, 1].mean())


def pinched(n: int, at: int) -> Callable[[str], float]:
    """The first or the second of both."""
    return lambda element: _pinched(n, element)[at]


def _vault(n: int, angle: float, R: float, half: float, t: float, E: float, nu: float,
           element: str, held: Callable[[Array], Array]) -> Statics:  # fmt: skip
    """Part of a tube about the y axis, from its top on, half of its length."""

    def place(a: Array, b: Array, c: Array) -> tuple[Array, Array, Array]:
        r = R + t * (c - 0.5)
        return r * np.sin(angle * a), half * b, r * np.cos(angle * a)

    domain = mapped((n, n, 1), place)
    domain = domain.with_facets(OUTSIDE, lambda x: np.hypot(x[0], x[2]) > R + 0.4 * t)
    return Statics(scene_of(domain, element, E, nu), held)


def roof(n: int) -> Callable[[str], float]:
    """Scordelis and Lo's: R = 25, 50 long, t = 0.25, ±40°, on stiff walls; its edge's middle."""

    def value(element: str) -> float:
        angle = np.radians(40)
        statics = _vault(n, angle, 25.0, 25.0, 0.25, 4.32e8, 0.0, element, lambda X: np.stack(
            [near(X[:, 0], 0.0) | near(X[:, 1], 0.0), near(X[:, 1], 25.0), near(X[:, 1], 0.0)],
            axis=1,
        ))  # fmt: skip
        X = statics.X
        f = np.zeros(X.shape)
        f[:, 2] = -90 / 0.25 * statics.scene.nodal_mass
        edge = near(np.arctan2(X[:, 0], X[:, 2]), angle) & near(X[:, 1], 25.0)
        return -float(statics.linear(f)[edge, 2].mean())

    return value


def cylinder(n: int) -> Callable[[str], float]:
    """Pinched by 1 at its middle: R = 300, 600 long, t = 3, between stiff walls; an eighth."""

    def value(element: str) -> float:
        statics = _vault(n, np.pi / 2, 300.0, 300.0, 3.0, 3e6, 0.3, element, lambda X: np.stack(
            [near(X[:, 0], 0.0) | near(X[:, 1], 0.0), near(X[:, 1], 300.0),
             near(X[:, 2], 0.0) | near(X[:, 1], 0.0)],
            axis=1,
        ))  # fmt: skip
        at = near(statics.X[:, 0], 0.0) & near(statics.X[:, 1], 300.0)
        f = np.zeros(statics.X.shape)
        f[at, 2] = -0.25 / at.sum()
        return -float(statics.linear(f)[at, 2].mean())

    return value
