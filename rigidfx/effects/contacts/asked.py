"""An obstacle as it is asked in a run: one of a user's own may tell anything, or fail."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.failures import Failures
from rigidfx.base.inputs import shown
from rigidfx.base.types import Array
from rigidfx.effects.contacts.obstacles import Approach, Obstacle

__all__ = ["AskedObstacle", "checked_approach", "checked_gap", "checked_outward"]

T = TypeVar("T")

UP = np.array([0.0, 0.0, 1.0])


def checked_gap(owner: str, obstacle: Obstacle, y: Array) -> Array:
    """Gaps of points y, shape (n, 3) [m].

    Raises:
        SceneError: On this rank, if they are not finite, or not as many as there are points.
    """
    return _numbers(owner, "gap", obstacle, obstacle.gap(y), y.shape[:1], y)


def checked_outward(owner: str, obstacle: Obstacle, y: Array) -> Array:
    """Directions in which gaps grow, likewise."""
    return _numbers(owner, "outward", obstacle, obstacle.outward(y), y.shape, y)


def checked_approach(owner: str, obstacle: Obstacle, y0: Array, y1: Array) -> Approach:
    """How gaps change from y0 to y1, likewise."""
    found = obstacle.approach(y0, y1)
    given = [(found.m, y0.shape), (found.dg, y0.shape)]
    if found.dm is not None:
        given.append((found.dm, (*y0.shape, 3)))
    for values, shape in given:
        _numbers(owner, "approach", obstacle, values, shape, y1)
    return found


def _numbers(
    owner: str, name: str, obstacle: Obstacle, given: Array, shape: tuple[int, ...], y: Array
) -> Array:
    if np.shape(given) == shape and (np.isfinite(given).all() or not np.isfinite(y).all()):
        return given
    raise SceneError(
        f"{owner}: {name} of the {obstacle.kind} must give finite numbers of shape {shape} for "
        f"points of shape {y.shape}, got {shown(given)}."
    )


class AskedObstacle:
    """An obstacle that is nowhere as soon as it fails, of which all ranks are told.

    Attributes:
        gap: See `Obstacle`.
        outward: Likewise.
        approach: Likewise.
    """

    def __init__(self, owner: str, obstacle: Obstacle, failures: Failures) -> None:
        """Take an obstacle over.

        Args:
            owner: Whose it is, for messages.
            obstacle: The question.
            failures: Keeps exceptions of it.
        """

        def heeded(
            name: str, function: Callable[..., T], instead: Callable[..., T]
        ) -> Callable[..., T]:
            def ask(*y: Array) -> T:
                return function(owner, obstacle, *y)

            return failures.heeded(owner, f"{name} of the {obstacle.kind}", ask, instead)

        self.gap = heeded("gap", checked_gap, lambda y: np.ones(len(y)))
        self.outward = heeded("outward", checked_outward, _up)
        self.approach = heeded(
            "approach", checked_approach, lambda y0, y1: Approach(_up(y0), None, _up(y0))
        )


def _up(y: Array) -> Array:
    return np.broadcast_to(UP, y.shape)
