"""The penalty U(g) = ½ k g₋² of a gap g, its secant [U] = (U₁ - U₀)/(g₁ - g₀), and forces by it.

A force -[U] in a variable whose increment is exact removes exactly the gain of U from the motion,
for any step (T. A. Laursen and V. Chawla, IJNME 40 (1997) 863). If one end is open, the denominator
exceeds the penetration at the other end, so 0/0 cannot occur.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rigidfx.base.types import Array, Ints
from rigidfx.effects.action import Action, Structure, Touch
from rigidfx.effects.motion import Instant

CLOSED = 1e-12  # of a point's coordinates: a gap that statics take for closed, as it rounds to zero
STALE = 0.05  # change of a derivative, which is k/2 at most, by k: a tangent does not fit any more


def stored(k: Array, g: Array) -> Array:
    """U of gaps g [m] with stiffnesses k [N/m], shape (n,) [J]."""
    return np.asarray(0.5 * k * np.minimum(g, 0.0) ** 2)


def secant(k: Array, g0: Array, g1: Array, static: bool = False) -> tuple[Array, Array]:
    """[U] at gaps from g0 to g1, which is never positive, and its derivative by g1, never negative.

    All have shape (n,) [m, N/m, N]. In statics both gaps are those at the end, and the derivative
    is by both.
    """
    closes, opens = (g0 >= 0) & (g1 < 0), (g0 < 0) & (g1 >= 0)
    apart = np.where(closes | opens, g1 - g0, 1.0)
    share0, share1 = g0 / apart, g1 / apart
    half = np.where((g0 < 0) & (g1 < 0), 0.5 * k, 0.0)
    value, slope = half * (g0 + g1), half
    value = np.where(closes, 0.5 * k * g1 * share1, value)
    slope = np.where(closes, 0.5 * k * share1 * (2 - share1), slope)
    value = np.where(opens, -0.5 * k * g0 * share0, value)
    slope = np.where(opens, 0.5 * k * share0**2, slope)
    return value, 2 * slope if static else slope


def soonest(g: Array, rate: Array) -> float:
    """Time [s] until the first of some gaps ≥ 0 closes at constant rates [m/s]; inf if none."""
    comes = rate < 0
    with np.errstate(over="ignore"):  # in longer than there are numbers
        return float((g[comes] / -rate[comes]).min(initial=np.inf))


class ContactForces(Action):
    """The forces of a contact at points with stiffnesses; its kind says which gaps they have."""

    presses = True

    def __init__(self, effect: Any, k: Array, structure: Structure) -> None:
        """Store the stiffnesses, shape (n,) [N/m]."""
        self.kind, self.title = effect.kind, effect.title
        self._k, self._static = k, structure.static
        self._in_tangent: Array = np.zeros(k.size)

    def _slopes(self) -> Array:
        """Derivatives of forces at the last iterate, shape (n,) or (several, n) [N/m]."""
        raise NotImplementedError

    def _gap(self, at: Instant) -> Array:
        """Gaps of all points, shape (n,) [m]."""
        raise NotImplementedError

    def outdated(self) -> bool:
        """Whether points of this rank closed, opened, stuck or slipped since the last tangent.

        A kept tangent is then renewed at once; a gradual change shows in residuals.
        """
        now = self._slopes()
        return bool((np.abs(now - self._in_tangent) > STALE * np.maximum(self._k, now)).any())

    def stored(self, at: Instant) -> float:
        """Σ U of the gaps [J]."""
        return float(stored(self._k, self._gap(at)).sum())

    def creep_for(self, time: float, began: Instant) -> None:
        """Let friction be that of a longer motion [s] from `began` on, until a time is set again.

        A step that needs forces by displacements, not by velocities, has no Δt of its own.
        """

    def pressing(self) -> tuple[Ints, Array]:
        """Owned nodes that are pressed, deeper than rounding, and how.

        Up to three directions of forces on each, the main one first and zero ones for none, shape
        (nodes, 3, 3).
        """
        raise NotImplementedError

    def closes_after(self, v: Array, dt: float, at: Instant) -> float:
        """Time until a node of this rank touches, at constant velocities v of the rows. Collective.

        Infinity if none does, -1 if one touches already [s]; dt is the length of the next step [s].
        """
        raise NotImplementedError

    def touch(self) -> Touch:
        """Touch of the contact on this rank in the step that has been solved."""
        raise NotImplementedError

    def _touched(self, k: Array, g: Array, force: Array, place: Array) -> Touch:
        """Touch of some points by their gaps, the forces on them and where these act."""
        return Touch(
            self.title,
            force=force.sum(axis=0),
            moment=np.cross(place, force).sum(axis=0),
            pressing=float(np.linalg.norm(force, axis=1).sum()),
            energy=float(stored(k, g).sum()),
            penetration=float(np.maximum(-g, 0.0).max(initial=0.0)),
            nodes=int(np.count_nonzero(g < 0)),
        )
