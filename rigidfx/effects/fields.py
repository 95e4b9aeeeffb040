"""Functions of place and time, f(x, t), beside those of time alone, f(t)."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError, together
from rigidfx.base.inputs import is_function, numbers
from rigidfx.base.types import Array, Indices, Ints

# Positions, shape (3, n) [m], and a time [s] → vectors, shape (3, n).
VectorField = Callable[[Array, float], npt.ArrayLike]
PlaceAndTime = VectorField | Callable[[float], tuple[float, float, float]]


def of_place(function: Any) -> bool:
    """Whether it is a function of place and time: it has to be given two arguments by position."""
    if not is_function(function):
        return False
    try:
        named = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # some built-in functions do not tell
        return False
    places = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(p.kind in places and p.default is p.empty for p in named) == 2


def values_at(function: Callable[..., Any], X: Array, t: float) -> Array:
    """Vectors of a function of place and time at points X and time t, shape (points, 3).

    The function may change its arguments in place. Unusable values come back as they are, an empty
    array where one is not of real numbers, to be told by its owner's check.
    """
    if not len(X):  # a rank may have none, and a function may not be made for that
        return np.zeros((0, 3))
    given = numbers(function(X.T.copy(), t))
    if given.shape == (3,):
        return np.broadcast_to(given, X.shape)
    if given.shape == (3, 1):
        return np.broadcast_to(given[:, 0], X.shape)
    return given.T


def check_values(owner: str, t: float, X: Array, values: Array) -> Array:
    """Vectors that a function of place and time gives at t [s] at points X, as they are.

    `SceneError` on this rank, unless they are one finite vector, or one for each point.
    """
    if np.shape(values) not in ((3,), X.shape) or not np.isfinite(values).all():
        raise SceneError(
            f"{owner}: at t = {t:g} s three finite components for each of {len(X)} points "
            f"are expected, shape (3, {len(X)}); got shape {values.shape[::-1]}: {values.T}."
        )
    return values


def values_of(owner: str, function: Callable[[Array], npt.ArrayLike], scene: Any) -> Array:
    """Vectors of a function of place at all local nodes, ghosts included, shape (nodes, 3).

    Collective. The function maps (3, n) [m] to (3, n), or to an array of which that can be made.
    `SceneError` on every rank, if it gives anything but finite vectors.
    """
    X = scene.space.tabulate_dof_coordinates()

    def found() -> Array:
        given = function(X.copy().T)  # it may change the positions in place
        values = numbers(given).T
        if values.size == 0 and np.size(given):
            raise TypeError("it gives no real numbers")
        values = np.broadcast_to(values, X.shape)
        if not np.isfinite(values).all():
            raise SceneError(f"{owner}: function gives values that are not finite.")
        return values

    return together(scene.comm, f"{owner}: function must map (3, n) to (3, n); it", found)


def some_points(scene: Any, nodes: Indices) -> Array:
    """A few positions among those of local nodes, the same on all ranks, shape (n, 3) [m].

    Collective. A change of a function of place is a change of a load where it is one at these.
    """
    X = scene.space.tabulate_dof_coordinates()[nodes]
    found = np.concatenate(scene.comm.allgather(X[np.unique(_extremes(X))]))
    return np.asarray(found[np.unique(_extremes(found))])


def _extremes(X: Array) -> Ints:
    """Which points lie furthest along each of several directions and against them."""
    if not len(X):
        return np.empty(0, np.int64)
    along = X @ np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [3, 2, 1], [-2, 3, 1], [1, -1, 5]]).T
    return np.concatenate([along.argmin(axis=0), along.argmax(axis=0)])
