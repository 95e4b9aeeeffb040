"""Stops: a joint's angle or travel is free between two ends, and sprung beyond them."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, isfinite, pi
from typing import Any, ClassVar, NamedTuple

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, shown
from rigidfx.base.warning import warn
from rigidfx.effects.joints.elements import OfJoint, coordinate_of
from rigidfx.effects.joints.law import Elastic

__all__ = ["Blow", "Stop"]


@dataclass(frozen=True)
class Stop(OfJoint, Elastic):
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

    def __post_init__(self) -> None:
        """Check name and values.

        Raises:
            SceneError: If a number is none, the ends are in the wrong order, or none is given.
        """
        super().__post_init__()
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
        self.check_law()

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


class Blow(NamedTuple):
    """How a stop, or a cable that is taut, acts in a step.

    Attributes:
        stop: The stop or cable, with a stiffness and a damping.
        effort: Size of its force or torque [N, N m].
        force: Size of that over the joint's size, where it is a torque [N].
        rate: Mean rate of the coordinate [rad/s, m/s].
        pressed: Whether it had most of its elongation at the start of the step.
    """

    stop: Any
    effort: float
    force: float
    rate: float
    pressed: bool
