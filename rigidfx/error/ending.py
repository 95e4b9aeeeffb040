"""The end of an error motion: it fades if nothing drives it, and is dropped if its algebra fails.

After a release e decays by the structure's damping. Its largest size in each connected part is
recorded through a window without bodies. If that size, relative to the largest displacement of the
same part, is everywhere below a twentieth of 0.8 κ tol/(peak strain rate), e is reduced to zero,
linearly in time, within another window.

The motion u needs no e. Where the linear algebra of e fails, nothing tells which rigid cells
strain, so that all bodies are released before the next step. Parts that qualify later freeze again,
with an e that begins anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np
from petsc4py import PETSc

from rigidfx.base.remembered import LARGEST, Remembered, same
from rigidfx.base.types import Array, Ints
from rigidfx.error.response import Response
from rigidfx.flexible.cell_strains import finite
from rigidfx.step.stepper import Stepper

__all__ = ["Ending", "Promise", "or_dropped"]

LITTLE = 0.04  # a twentieth of 0.8: of what is allowed, that is let go
T = TypeVar("T")


class _Dropped(Protocol):
    """Something that can begin anew: see `ErrorMotion`."""

    def drop(self, error: Exception) -> None:
        """Begin anew after a failure. Collective."""
        ...


def or_dropped(method: Callable[..., T]) -> Callable[..., T]:
    """A method whose failures drop e; it is called once more then, where e is zero. Collective."""

    @wraps(method)
    def guarded(owner: _Dropped, *given: Any, **named: Any) -> T:
        try:
            return method(owner, *given, **named)
        except (np.linalg.LinAlgError, PETSc.Error) as error:
            owner.drop(error)
            return method(owner, *given, **named)

    return guarded


@dataclass(frozen=True)
class Promise:
    """The bound on e by a criterion.

    Attributes:
        part: Of the largest displacement, for the peak strain rate so far [1/s]. Collective.
        window: Length of a window [s]; NaN while it is not known. Collective.
    """

    part: Callable[[float], float]
    window: Callable[[], float]


class Ending:
    """Watches how large e is.

    Attributes:
        let_go: Largest |e| that has been let go so far [m].
    """

    remembered: ClassVar[Remembered] = same("let_go", "_watched", "_left") | {"_most": LARGEST}

    def __init__(self, stepper: Stepper, promise: Promise) -> None:
        """Nothing has moved.

        Args:
            stepper: Makes the steps.
            promise: Bounds of e.
        """
        self._stepper, self._promise = stepper, promise
        self.let_go = 0.0
        # |e| and displacement of each connected part, then strain rate; the first of a window.
        self._most: Array = np.zeros(2 * stepper.scene.parts.count + 1)
        self._watched = self._left = 0.0  # time in this window, and until e is zero [s]

    def part(self, dt: float, response: Response, parts: Ints) -> float:
        """The rest of e after a step, as a part of its former value. Collective.

        Args:
            dt: Length of the step [s].
            response: Has e.
            parts: Connected part of each owned node.

        Raises:
            LinAlgError: On every rank, if e is not finite.
        """
        e = finite(response.coarse(), self._stepper.scene.comm)
        state, indicator = self._stepper.state, self._stepper.indicator
        moved = state.places - state.X[: len(e)]
        own = np.zeros((2, self._stepper.scene.parts.count))
        for most, vectors in zip(own, (e, moved), strict=True):
            np.maximum.at(most, parts, np.linalg.norm(vectors, axis=1))
        rate = 0.0 if indicator is None else indicator.values.max(initial=0.0)
        self._most = np.maximum(self._most, [*own.ravel(), rate])
        if self._stepper.system.actions.easing or len(state.bodies):
            self._forget()
            self._left = 0.0
            return 1.0
        if self._left > 0:
            part = max(1 - dt / self._left, 0.0)
            self._left = max(self._left - dt, 0.0)
            return part
        self._watched += dt
        window = self._promise.window()
        if self._watched >= window:
            self._window_ends(window)
        return 1.0

    def _window_ends(self, window: float) -> None:
        """Begin to fade if little is left. Collective."""
        most = np.max(self._stepper.scene.comm.allgather(self._most), axis=0)
        size, moved = most[:-1].reshape(2, -1)
        little = LITTLE * self._promise.part(float(most[-1])) * moved
        if size.any() and (size <= little).all():
            self._left, self.let_go = window, max(self.let_go, float(size.max()))
        self._forget()

    def _forget(self) -> None:
        """Begin another window."""
        self._most[: self._most.size // 2] = self._watched = 0.0
