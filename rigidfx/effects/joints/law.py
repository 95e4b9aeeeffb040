"""The law of springs with dampers, of stops and of cables along a coordinate q.

With P(q) the way beyond an end, below zero beyond the lower one, a law stores ½ k P² and exerts

    -f,    f = ½ k (P₀ + P₁) (P₁ - P₀)/(q₁ - q₀) + c (P₁ - P₀)/Δt

in a step from q₀ to q₁: its work is exactly the energy that it gives, less c (P₁ - P₀)(q₁ - q₀)/Δt,
which its damper takes (O. Gonzalez, J. Nonlinear Sci. 6 (1996) 449). Where both ends are one place,
P is the way from there: a spring. With two ends, or one, q is free between them: a stop or a cable,
which only pushes back. Where the damper would make f pull, on the way back, f is zero. Then the
damper takes all of the energy ½ k (P₀² - P₁²) that the spring gives, which is never below zero.
"""

from __future__ import annotations

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, shown
from rigidfx.effects.base import Effect

__all__ = ["Elastic"]


class Elastic(Effect):
    """An effect with such a law.

    Attributes:
        stiffness: k [N/m, or N m/rad].
        damping: c [N s/m, or N m s/rad].
    """

    stiffness: float
    damping: float

    @property
    def loose(self) -> float:
        """Way by which q may be short of an end that is stiff in statics already [rad or m]."""
        return 0.0

    @property
    def ends_at(self) -> tuple[float, float]:
        """Both ends, infinite where there is none [rad or m]."""
        raise NotImplementedError

    @property
    def is_spring(self) -> bool:
        """Whether both ends are one place."""
        low, high = self.ends_at
        return low == high

    @property
    def resists(self) -> bool:
        """Whether it resists all that changes its coordinate, at all times."""
        return self.stiffness > 0 and self.is_spring

    def check_law(self, *more: str) -> None:
        """Check k, c and further fields.

        Raises:
            SceneError: If one of them is no number ≥ 0.
        """
        for name in ("stiffness", "damping", *more):
            if number(self.owner, name, getattr(self, name)) < 0:
                raise SceneError(
                    f"{self.owner}: {name} must be ≥ 0, got {shown(getattr(self, name))}."
                )

    def beyond(self, q: float) -> float:
        """P at q [rad or m]."""
        low, high = self.ends_at
        return max(q - high, 0.0) + min(q - low, 0.0)

    def is_stiff(self, q: float) -> bool:
        """Whether P changes with q there, in statics."""
        low, high = self.ends_at
        return self.is_spring or q > high - self.loose or q < low + self.loose

    def _parts(self, q0: float, q1: float, dt: float) -> tuple[float, float, float]:
        """Resistance by stiffness and by damping in a step, and the derivative of both by q₁.

        Args:
            q0: q at its start.
            q1: q at its end.
            dt: Its length [s].
        """
        P0, P1, moved, spring = self.beyond(q0), self.beyond(q1), q1 - q0, self.is_spring
        gained, slope1 = (moved, 1.0) if spring else (P1 - P0, float(P1 != 0.0))
        slope, bend = slope1, 0.0
        if not spring and P0 * P1 <= 0 and moved:
            slope = gained / moved
            bend = (slope1 - slope) / moved
        k, c = self.stiffness, self.damping / dt
        elastic, viscous = 0.5 * k * (P0 + P1) * slope, c * gained
        if not spring and (elastic + viscous) * (P0 + P1) <= 0:
            return elastic, -elastic, 0.0
        return elastic, viscous, 0.5 * k * (slope1 * slope + (P0 + P1) * bend) + c * slope1

    def law(self, q0: float, q1: float, dt: float) -> tuple[float, float]:
        """Force or torque along q in a step, and its derivative by q₁: see `_parts`."""
        elastic, viscous, slope = self._parts(q0, q1, dt)
        return -elastic - viscous, -slope

    def pull(self, q: float) -> tuple[float, float]:
        """Force or torque along q of statics, and its derivative."""
        return -self.stiffness * self.beyond(q), -self.stiffness * self.is_stiff(q)

    def stored(self, q: float) -> float:
        """Energy at q [J]."""
        return 0.5 * self.stiffness * self.beyond(q) ** 2

    def taken(self, q0: float, q1: float, dt: float) -> float:
        """Energy that its damper takes in a step [J]: see `_parts`."""
        return self._parts(q0, q1, dt)[1] * (q1 - q0)
