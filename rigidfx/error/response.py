"""Solutions of the error's equation M ë + C ė + K e = r: by all unknowns, or by modes.

Both know e and ė at the owned nodes, in the frame of the shape, and step under a mean force.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.base.remembered import ON_NODES, SAME, Items, Remembered
from rigidfx.base.types import Array
from rigidfx.error.linear_motion import LinearMotion

__all__ = ["FACTORING", "PREPARING", "AllUnknowns", "Response"]


# Parts of the set-up in PETSc's log: matrices and modes; factors, of which it has the number.
PREPARING = PETSc.Log.Event("rigidfxErrorSetup")
FACTORING = PETSc.Log.Event("rigidfxErrorFactor")


class Response(Protocol):
    """A solution of the error's equation; `destroy` frees its PETSc objects."""

    @property
    def moving(self) -> bool:
        """Whether e or ė is not zero on this rank."""
        ...

    @property
    def valid(self) -> bool:
        """Whether e is known; equal on all ranks."""
        ...

    @property
    def hurried(self) -> bool:
        """Whether forces change too fast for a good e; equal on all ranks."""
        ...

    def kick(self, change: Array) -> None:
        """Add to ė where no support holds it, shape (nodes, 3) [m/s]. Collective."""
        ...

    def step(self, force: Array, dt: float, drag: float, xi: float) -> None:
        """Step under a mean force. Collective.

        Args:
            force: Shape (nodes, 3) [N].
            dt: Length of the step [s].
            drag: α of a force -α M ė [1/s].
            xi: ξ of the numerical damping.
        """
        ...

    def fields(self) -> tuple[Array, Array]:
        """e [m] and ė [m/s] at the owned nodes, shape (nodes, 3) each. Collective."""
        ...

    def coarse(self) -> Array:
        """e without its static part, shape (nodes, 3) [m]. Collective."""
        ...

    def change(self) -> tuple[Array, float]:
        """Change of e, shape (nodes, 3) [m], and its time [s]. Collective.

        In the last step; by modes since it was asked for last, as it takes a solve.
        """
        ...

    def scale(self, part: Array) -> None:
        """Scale e and ė by a factor of shape (nodes,); by modes the largest of all. Collective."""
        ...

    def kept(self) -> object:
        """The data by which `restore` takes steps and kicks from now on back."""
        ...

    def restore(self, kept: Any) -> None:
        """Be as at `kept`, which is for one response only."""
        ...

    def at(self, sums: Sequence[csr_array]) -> tuple[Array, Array]:
        """This rank's part of some sums of e and of ė, shape (sums, 3) each.

        Args:
            sums: Weights of the owned dofs, shape (3, dofs) each: see `rigidfx.error.error_motion`.
        """
        ...

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        ...


class AllUnknowns:
    """e by the midpoint rule at all nodes, with kept factors."""

    remembered: ClassVar[Remembered] = {
        "_e": ON_NODES,
        "_rate": ON_NODES,
        "_change": Items(ON_NODES, SAME),
    }

    valid, hurried = True, False

    def __init__(self, motion: LinearMotion, e: Array, rate: Array) -> None:
        """Keep the equations.

        Args:
            motion: The equations of all rows; owned from now on.
            e: At their start, shape (nodes, 3) [m].
            rate: Its rate, likewise [m/s].
        """
        self._motion, self._e, self._rate = motion, e, rate
        self._change: tuple[Array, float] = np.zeros_like(e), 1.0

    @property
    def moving(self) -> bool:
        """Whether e or ė is not zero on this rank."""
        return bool(self._e.any() or self._rate.any())

    def operator(self, dt: float, drag: float, xi: float) -> PETSc.Mat:
        """The matrix that a step solves with; its solver's own. Collective."""
        return self._motion.factored(dt, drag, xi).getOperators()[0]

    def kick(self, change: Array) -> None:
        """Add to ė where no support holds it, shape (nodes, 3) [m/s]. Collective."""
        self._rate = self._motion.halted(self._rate + change)

    def step(
        self, force: Array, dt: float, drag: float, xi: float, led: Array | None = None
    ) -> None:
        """See `Response`.

        Args:
            force: See there.
            dt: See there.
            drag: See there.
            xi: See there.
            led: Increments at dofs that supports hold, zero elsewhere, shape (nodes, 3) [m].
        """
        if not self._motion.has_factors(dt, drag, xi):
            with FACTORING:
                self._motion.factored(dt, drag, xi)
        d = self._motion.increment(force, self._e, self._rate, dt, drag, xi, led)
        self._e, self._rate = self._e + d, 2 / dt * d - self._rate
        if led is not None:  # no path of a support rings
            self._rate = np.where(led != 0, led / dt, self._rate)
        self._change = d, dt

    def coarse(self) -> Array:
        """All of e, shape (nodes, 3) [m]."""
        return self._e

    def change(self) -> tuple[Array, float]:
        """Change of e in the last step, shape (nodes, 3) [m], and its length [s]."""
        return self._change

    def shift(self, more: Array, dt: float) -> None:
        """Add to e at the end of the last step.

        Args:
            more: Shape (nodes, 3) [m].
            dt: Length of that step [s].
        """
        self._e, self._rate = self._e + more, self._rate + 2 / dt * more
        self._change = self._change[0] + more, dt

    def by_impulses(self, momenta: Array) -> Array:
        """Velocities that impulses bring: see `LinearMotion`. Collective."""
        return self._motion.by_impulses(momenta)

    def rest(self) -> None:
        """Set e and ė to zero."""
        self._e = self._rate = np.zeros_like(self._e)

    def scale(self, part: Array) -> None:
        """Scale e and ė by a factor of shape (nodes,)."""
        self._e, self._rate = part[:, None] * self._e, part[:, None] * self._rate

    def kept(self) -> object:
        """e, ė and the change of e."""
        return self._e, self._rate, self._change

    def restore(self, kept: Any) -> None:
        """Take e, ė and the change of e back."""
        self._e, self._rate, self._change = kept

    def fields(self) -> tuple[Array, Array]:
        """e [m] and ė [m/s] at the owned nodes, shape (nodes, 3) each."""
        return self._e, self._rate

    def at(self, sums: Sequence[csr_array]) -> tuple[Array, Array]:
        """This rank's part of some sums of e and of ė, shape (sums, 3) each."""
        e, rate = (
            np.reshape([own @ a.reshape(-1) for own in sums], (-1, 3))
            for a in (self._e, self._rate)
        )
        return e, rate

    def destroy(self) -> None:
        """Free the equations. Collective."""
        self._motion.destroy()
