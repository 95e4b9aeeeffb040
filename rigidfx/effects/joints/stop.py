"""Stops: a joint's angle or travel is free between two ends, and sprung beyond them.

With P(q) the way beyond an end, below zero beyond the lower one, a stop stores ½ k P² and exerts

    -f,    f = ½ k (P₀ + P₁) (P₁ - P₀)/(q₁ - q₀) + c (P₁ - P₀)/Δt

in a step from q₀ to q₁: its work is exactly the energy that it gives, less c (P₁ - P₀)(q₁ - q₀)/Δt,
which its damper takes (O. Gonzalez, J. Nonlinear Sci. 6 (1996) 449). A stop only pushes: where the
damper would make f pull, on the way back, f is zero. Then the damper takes all of the energy
½ k (P₀² - P₁²) that the spring gives, which is never below zero.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, isfinite, pi
from typing import Any, ClassVar, NamedTuple

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, shown
from rigidfx.base.warning import warn
from rigidfx.effects.base import Effect
from rigidfx.effects.joints.elements import coordinate_of

__all__ = ["Blow", "Stop"]


@dataclass(frozen=True)
class Stop(Effect):
    """Limits of the angle or travel of a joint, with a stiffness and a damper.

    Turns count. A stop only pushes: if its damper would pull on the way back, it has no force. A
    run whose joint starts beyond a limit is refused, unless a static solution has led there.

    Attributes:
        joint: Name of the joint.
        low: Lower end [rad or m]; none if None.
        high: Upper end, likewise.
        stiffness: k > 0 of an end [N m/rad, or N/m].
        damping: c of an end [N m s/rad, or N s/m].
        along: "angle" or "travel"; needed of a joint that leaves both free.
    """

    joint: str
    low: float | None = None
    high: float | None = None
    stiffness: float = field(kw_only=True)
    damping: float = field(default=0.0, kw_only=True)
    along: str | None = field(default=None, kw_only=True)

    is_lasting: ClassVar[bool] = True
    resists: ClassVar[bool] = False  # whether it resists all that changes its coordinate

    def __post_init__(self) -> None:
        """Check name and values.

        Raises:
            SceneError: If a number is none, the ends are in the wrong order, or none is given.
        """
        super().__post_init__()
        if not isinstance(self.joint, str) or not self.joint:
            raise SceneError(f"Stop: joint must be the name of a joint, got {shown(self.joint)}.")
        for name in ("low", "high"):
            if getattr(self, name) is not None:
                number(self.owner, name, getattr(self, name))
        if self.low is None and self.high is None:
            raise SceneError(f"{self.owner}: give low, high or both.")
        if not self.ends_at[0] < self.ends_at[1]:
            raise SceneError(
                f"{self.owner}: low must be below high, got {shown(self.low)} and "
                f"{shown(self.high)}."
            )
        if not number(self.owner, "stiffness", self.stiffness) > 0:
            raise SceneError(f"{self.owner}: stiffness must be > 0, got {shown(self.stiffness)}.")
        if number(self.owner, "damping", self.damping) < 0:
            raise SceneError(f"{self.owner}: damping must be ≥ 0, got {shown(self.damping)}.")
        if self.along not in (None, "angle", "travel"):
            raise SceneError(
                f"{self.owner}: along must be 'angle' or 'travel', got {shown(self.along)}."
            )

    @property
    def owner(self) -> str:
        """Its name in messages."""
        return f"Stop of '{self.joint}'"

    @property
    def acts_along(self) -> str | None:
        """Its coordinate, "angle" or "travel"; the only one that is free if None."""
        return self.along

    @property
    def ends_at(self) -> tuple[float, float]:
        """Both ends, infinite where there is none [rad or m]."""
        return (
            -inf if self.low is None else float(self.low),
            inf if self.high is None else float(self.high),
        )

    def check(self, scene: Any) -> None:
        """Look its joint up."""
        _, name = coordinate_of(scene, self.owner, self.joint, self.along)
        largest = max(abs(end) for end in self.ends_at if isfinite(end))
        if name == "angle" and largest > 4 * pi:
            warn(
                scene.comm,
                f"{self.owner}: its ends are in rad, and {largest:g} is more than two turns. Are "
                "they in degrees? np.radians(…) makes rad of them.",
            )

    def beyond(self, q: float) -> float:
        """Way beyond an end, below zero beyond the lower one [rad or m]."""
        low, high = self.ends_at
        return max(q - high, 0.0) + min(q - low, 0.0)

    def law(self, q0: float, q1: float, dt: float) -> tuple[float, float]:
        """Force or torque on the second side in a step, and its derivative by q₁.

        Args:
            q0: q at its start.
            q1: q at its end.
            dt: Its length [s]; infinite in statics.
        """
        of_spring, by_spring = self._of_spring(q0, q1)
        P0, P1 = self.beyond(q0), self.beyond(q1)
        force = of_spring - self.damping * (P1 - P0) / dt
        if force * (P0 + P1) >= 0:
            return 0.0, 0.0
        return force, by_spring - self.damping * float(P1 != 0.0) / dt

    def _of_spring(self, q0: float, q1: float) -> tuple[float, float]:
        """The same of its spring alone."""
        P0, P1, moved = self.beyond(q0), self.beyond(q1), q1 - q0
        slope1 = float(P1 != 0.0)
        if moved:
            slope = (P1 - P0) / moved
            bend = (slope1 - slope) / moved
        else:
            slope, bend = slope1, 0.0
        force = -0.5 * self.stiffness * (P0 + P1) * slope
        return force, -0.5 * self.stiffness * (slope1 * slope + (P0 + P1) * bend)

    def pull(self, q: float) -> tuple[float, float]:
        """Force or torque of statics at q, and its derivative."""
        P = self.beyond(q)
        return -self.stiffness * P, -self.stiffness * float(P != 0.0)

    def stored(self, q: float) -> float:
        """Energy at q [J]."""
        return 0.5 * self.stiffness * self.beyond(q) ** 2

    def taken(self, q0: float, q1: float, dt: float) -> float:
        """Energy that its damper takes in a step [J]."""
        return (self._of_spring(q0, q1)[0] - self.law(q0, q1, dt)[0]) * (q1 - q0)


class Blow(NamedTuple):
    """How a stop, or a cable that is taut, acts in a step.

    Attributes:
        stop: The stop or cable, with a stiffness and a damping.
        effort: Size of its force or torque [N, N m].
        force: Size of that over the joint's size, where it is a torque [N].
        rate: Mean rate of the coordinate [rad/s, m/s].
    """

    stop: Any
    effort: float
    force: float
    rate: float
