"""Cases in which first-order cells lock, with known answers: meshes, loads, what is looked at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.sparse import csr_array, lil_array

import rigidfx as rf

from .graded import block_of
from .statics import Statics

Array = npt.NDArray[np.float64]

ELEMENTS = {"standard": 1, "enhanced": 1, "assumed": 1, "second order": 2}  # and their orders
SOLID = "standard", "enhanced", "second order"
# Second order is nobody's rival where steps are many and large, and standard cells take longest.
PROMISED = "enhanced", "assumed"
OUTSIDE = "outside"  # facets that the thickness of a thin part goes away from


@dataclass(frozen=True)
class Case:
    """A problem of statics with a known answer.

    Attributes:
        name: What it is called.
        mesh: Cells along each axis.
        reference: The answer [m]; None if second-order cells give it.
        value: The computed one, of an element.
        elements: Those that are asked.
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
    """Of a scene; the second order is standard."""
    kinds = {"enhanced": "enhanced", "assumed": rf.AssumedStrains(OUTSIDE)}
    return {"order": ELEMENTS[element], "element": kinds.get(element, "standard")}


def scene_of(domain: rf.Domain, element: str, E: float, nu: float) -> rf.Scene:
    """A scene of one material."""
    material = rf.StVenantKirchhoff(E=E, nu=nu, rho=1.0)
    return rf.Scene(domain, material, **options_of(element))


def near(x: Array, value: float) -> Array:
    """Whether coordinates are a value."""
    return np.abs(x - value) < 1e-8 * (1 + abs(value))


def box(size: tuple[float, float, float], n: tuple[int, int, int]) -> rf.Domain:
    """With named faces x0 … z1, the last of which is the outside, too."""
    domain = rf.box((0, 0, 0), size, n, comm=MPI.COMM_SELF)
    return domain.with_facets(OUTSIDE, lambda x: near(x[2], size[2]))


def clamped(X: Array) -> Array:
    """All of x = 0."""
    return np.repeat(near(X[:, :1], 0.0), 3, axis=1)


def on_face(statics: Statics, face: str, traction: tuple[float, float, float]) -> Array:
    """Nodal forces of a traction, shape (nodes, 3)."""
    weights = statics.scene.facet_weights(face, "benchmark")
    return weights[:, None] * np.asarray(traction)


def cantilever(axis: int) -> Callable[[str], float]:
    """MacNeal and Harder's straight beam of six cells: 6 × 0.2 × 0.1, under 1 at its tip."""

    def value(element: str) -> float:
        statics = Statics(scene_of(box((6, 0.2, 0.1), (6, 1, 1)), element, 1e7, 0.3), clamped)
        direction = np.eye(3)[axis] / (0.2 * 0.1)
        u = statics.linear(on_face(statics, "x1", tuple(direction)))
        return float(u[near(statics.X[:, 0], 6.0), axis].mean())

    return value


def plate(slenderness: float, n: int) -> Callable[[str], float]:
    """A clamped square plate under 1 Pa, a quarter of it; its middle, over q a⁴/D."""

    def value(element: str) -> float:
        t = 1 / slenderness
        statics = Statics(
            scene_of(box((0.5, 0.5, t), (n, n, 1)), element, 1e7, 0.3),
            lambda X: np.stack(
                [
                    near(X[:, 0], 0.0) | near(X[:, 0], 0.5) | near(X[:, 1], 0.5),
                    near(X[:, 1], 0.0) | near(X[:, 0], 0.5) | near(X[:, 1], 0.5),
                    near(X[:, 0], 0.5) | near(X[:, 1], 0.5),
                ],
                axis=1,
            ),
        )
        u = statics.linear(on_face(statics, "z1", (0, 0, 1.0)))
        middle = near(statics.X[:, 0], 0.0) & near(statics.X[:, 1], 0.0)
        return float(u[middle, 2].mean()) * 1e7 * t**3 / (12 * (1 - 0.3**2))

    return value


def cook(n: int) -> Callable[[str], float]:
    """Cook's membrane in plane stress, half of its thickness; its free edge at (48, 52)."""

    def value(element: str) -> float:
        domain = mapped(
            (n, n, 1), lambda a, b, c: (48 * a, 44 * (a + b) - 28 * a * b, 0.5 * c)
        ).with_facets("end", lambda x: near(x[0], 48.0))
        statics = Statics(
            scene_of(domain, element, 1.0, 1 / 3),
            lambda X: np.stack(
                [near(X[:, 0], 0.0), near(X[:, 0], 0.0), near(X[:, 2], 0.0)], axis=1
            ),
        )
        u = statics.linear(on_face(statics, "end", (0, 1 / 16, 0)))
        at = near(statics.X[:, 0], 48.0) & near(statics.X[:, 1], 52.0)
        return float(u[at, 1].mean())

    return value


def large_deflection(axis: int) -> Callable[[str], float]:
    """A cantilever of 10 × 1 × 0.1 m under 4 N at its end (Sze, Liu and Lo 2004)."""

    def value(element: str) -> float:
        statics = Statics(scene_of(box((10, 1, 0.1), (16, 1, 1)), element, 1.2e6, 0.0), clamped)
        f = on_face(statics, "x1", (0, 0, 4 / 0.1)).reshape(-1)
        u = statics.loaded(lambda u, s: (s * f, None), 20)
        return abs(float(u[near(statics.X[:, 0], 10.0), axis].mean()))

    return value


def roll_up(n: int) -> Callable[[str], float]:
    """A strip of 12 × 1 × 0.1 m rolled up by 2πEI/L at its end: how far that goes back."""

    def value(element: str) -> float:
        length, t, moment = 12.0, 0.1, 2 * np.pi * 1.2e6 * 0.1**3 / 12 / 12.0
        statics = Statics(scene_of(box((length, 1, t), (n, 1, 1)), element, 1.2e6, 0.0), clamped)
        X, end = statics.X, near(statics.X[:, 0], length)
        low, high = (np.flatnonzero(end & near(X[:, 2], z)) for z in (0.0, t))
        low, high = (k[np.argsort(X[k, 1])] for k in (low, high))
        share = np.array([0.5, 0.5]) if low.size == 2 else np.array([1, 4, 1]) / 6
        turn = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])  # about y

        def load(u: Array, s: float) -> tuple[Array, csr_array]:
            f, change = np.zeros(u.shape), lil_array((u.size, u.size))
            for a, b, w in zip(low, high, share, strict=True):
                r = X[b] + u[b] - X[a] - u[a]
                rr = float(r @ r)
                m = -s * moment * w
                pair = m / rr * turn @ r
                by_r = m / rr * (turn - 2 * np.outer(turn @ r, r) / rr)
                f[b] += pair
                f[a] -= pair
                for i, sign_i in ((b, 1), (a, -1)):
                    for j, sign_j in ((b, 1), (a, -1)):
                        change[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] += sign_i * sign_j * by_r
            return f.reshape(-1), change.tocsr()

        u = statics.loaded(load, 40)
        return -float(u[end, 0].mean())

    return value


def incompressible(n: int) -> Callable[[str], float]:
    """A cube of ν = 0.4999 on its bottom, pressed on a quarter of its top: how far that gives."""

    def value(element: str) -> float:
        corner = box((1, 1, 1), (n, n, n)).with_facets(
            "pressed", lambda x: near(x[2], 1.0) & (x[0] < 0.5 + 1e-8) & (x[1] < 0.5 + 1e-8)
        )
        statics = Statics(
            scene_of(corner, element, 1.0, 0.4999),
            lambda X: np.repeat(near(X[:, 2:], 0.0), 3, axis=1),
        )
        f = on_face(statics, "pressed", (0, 0, -1.0))
        return -float((statics.linear(f) * f).sum() / f.sum())

    return value


def squeezed(element: str, stretch: float, confined: bool, n: int = 4) -> float:
    """Lowest eigenvalue of a compressed cube with held top and bottom, over the one at rest.

    Confined, the whole of its surface is held.
    """

    def held(X: Array) -> Array:
        outside = near(X, 0.0) | near(X, 1.0)
        mask = outside.any(axis=1) if confined else outside[:, 2]
        return np.repeat(mask[:, None], 3, axis=1)

    statics = Statics(scene_of(box((1, 1, 1), (n, n, n)), element, 1.0, 0.3), held)
    u = np.zeros(statics.X.shape)
    rest = statics.softest(u)
    u[:, 2] = (stretch - 1) * statics.X[:, 2]
    return statics.softest(u) / rest
