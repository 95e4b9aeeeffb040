"""Actions along free coordinates of a joint: motors, springs with dampers, and stops.

docs/theory/joints.md#coordinates has the law of springs, stops and cables along a coordinate q.
P(q) is the way beyond an end, below zero beyond the lower one. Where both ends are one place, P is
the way from there: a spring. With two ends, or one, q is free between them: a stop or a cable,
which only pushes back. Where the damper would make the force pull, on the way back, the force is
zero, and the damper takes all of the energy that the spring gives, which is never below zero.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, isfinite, pi
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rigidfx.base.errors import SceneError, by_name, together
from rigidfx.base.inputs import at_least_zero, is_function, number, positive, scalar, shown
from rigidfx.base.taken import Checks
from rigidfx.base.warning import warn
from rigidfx.effects.base import Effect, TimeFunction, Windowed, one_of, text
from rigidfx.effects.joints.joint import Joint

KINDS = {
    "torque": ("angle", False),
    "angle": ("angle", True),
    "speed": ("angle", True),
    "force": ("travel", False),
    "travel": ("travel", True),
    "rate": ("travel", True),
}
SOON = float(np.sqrt(np.sqrt(np.finfo(np.float64).eps)))  # of Δt: where a path's speed is found


class Elastic(Effect):
    """An effect with such a law, by its stiffness k and damping c."""

    checks: ClassVar[Checks] = {"stiffness": at_least_zero, "damping": at_least_zero}
    loose = 0.0  # way by which q may be short of an end that is stiff in statics already

    stiffness: float
    damping: float

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

    def beyond(self, q: float) -> float:
        """P at q [rad or m]."""
        low, high = self.ends_at
        return max(q - high, 0.0) + min(q - low, 0.0)

    def is_stiff(self, q: float) -> bool:
        """Whether P changes with q there, in statics."""
        low, high = self.ends_at
        return self.is_spring or q > high - self.loose or q < low + self.loose

    def law(self, q0: float, q1: float, dt: float) -> tuple[float, float, float]:
        """Force or torque along q in a step, its derivative by q₁, and loss by the damper [J]."""
        P0, P1, moved, spring = self.beyond(q0), self.beyond(q1), q1 - q0, self.is_spring
        gained, slope1 = (moved, 1.0) if spring else (P1 - P0, float(P1 != 0.0))
        slope, bend = slope1, 0.0
        if not spring and P0 * P1 <= 0 and moved:
            slope = gained / moved
            bend = (slope1 - slope) / moved
        k, c = self.stiffness, self.damping / dt
        elastic, viscous = 0.5 * k * (P0 + P1) * slope, c * gained
        if not spring and (elastic + viscous) * (P0 + P1) <= 0:
            return 0.0, 0.0, -elastic * moved
        by_end = 0.5 * k * (slope1 * slope + (P0 + P1) * bend) + c * slope1
        return -elastic - viscous, -by_end, viscous * moved

    def pull(self, q: float) -> tuple[float, float]:
        """Force or torque along q of statics, and its derivative."""
        return -self.stiffness * self.beyond(q), -self.stiffness * self.is_stiff(q)

    def stored(self, q: float) -> float:
        """Energy at q [J]."""
        return 0.5 * self.stiffness * self.beyond(q) ** 2


class OfJoint(Effect):
    """An effect along a free coordinate of a joint."""

    checks: ClassVar[Checks] = {
        "joint": text("the name of a joint"),
        "along": one_of("angle", "travel"),
    }

    joint: str
    along: str | None = None

    @property
    def owner(self) -> str:
        """Its name in messages."""
        return f"{self.kind} of '{self.joint}'"

    @property
    def acts_along(self) -> str | None:
        """Its coordinate, "angle" or "travel"; the only one that is free if None."""
        return self.along

    def check(self, scene: Any) -> None:
        """Look its joint up."""
        coordinate_of(scene, self.owner, self.joint, self.acts_along)


@dataclass(frozen=True)
class Motor(OfJoint, Windowed):
    """Drives a joint along a free coordinate, the second side against the first.

    Give exactly one of the six, a number or a function of time. `speed=0.0`, or `rate=0.0`, locks
    the joint for the time of the window.

    Attributes:
        joint: Name of the joint.
        torque: About its axis [N m].
        angle: About its axis, from the start on; turns count [rad].
        speed: About its axis [rad/s]; the angle is its integral by Simpson's rule in each step.
        force: Along its axis [N].
        travel: Along its axis, from the start on [m].
        rate: Along its axis [m/s], likewise.
    """

    is_load: ClassVar[bool] = True

    joint: str
    torque: float | TimeFunction | None = field(default=None, kw_only=True)
    angle: float | TimeFunction | None = field(default=None, kw_only=True)
    speed: float | TimeFunction | None = field(default=None, kw_only=True)
    force: float | TimeFunction | None = field(default=None, kw_only=True)
    travel: float | TimeFunction | None = field(default=None, kw_only=True)
    rate: float | TimeFunction | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Refuse all but one value, which is a number or a function."""
        super().__post_init__()
        given = [name for name in KINDS if getattr(self, name) is not None]
        if len(given) != 1:
            raise SceneError(
                f"{self.owner}: give exactly one of {', '.join(KINDS)}; got "
                f"{', '.join(given) or 'none'}."
            )
        if not is_function(getattr(self, given[0])):
            number(self.owner, given[0], getattr(self, given[0]))

    @property
    def by(self) -> str:
        """Which of its values is given."""
        return next(name for name in KINDS if getattr(self, name) is not None)

    @property
    def acts_along(self) -> str:
        """Its coordinate: "angle" or "travel"."""
        return KINDS[self.by][0]

    @property
    def prescribes(self) -> bool:  # type: ignore[override]
        """Whether it prescribes that, and not its force."""
        return KINDS[self.by][1]

    @property
    def grows(self) -> str | None:  # type: ignore[override]
        """Its torque or force; None of a motor that prescribes a motion."""
        return None if self.prescribes else self.by

    resists = prescribes

    @property
    def by_speed(self) -> bool:
        """Whether it prescribes a speed or a rate."""
        return self.by in ("speed", "rate")

    def speed_at(self, t: float, dt: float) -> float:
        """The speed that it prescribes just after t [rad/s, m/s].

        Over a small part of a step of length dt [s] an angle or a travel is followed.
        """
        if self.by_speed:
            return self.at(t)
        h = SOON * dt
        first, middle, last = (self.at(t + k * h) for k in range(3))
        return float(end_rates(first, last, middle, 2 * h)[0])

    def drive(self, t: float, dt: float) -> float:
        """Its torque or force, or the speed that it prescribes, while it acts; else zero."""
        if not self.acts(t):
            return 0.0
        return self.speed_at(t, dt) if self.prescribes else self.at(t)

    def at(self, t: float) -> float:
        """Its value at t [s]; raise `SceneError` if its function gives no finite number."""
        given: float | Callable[[float], float] = getattr(self, self.by)
        if not callable(given):
            return float(given)
        value = by_name(self.owner, t, lambda: scalar(given(t)), self.by)
        return number(f"{self.owner} at t = {t:g} s", self.by, value)

    def check(self, scene: Any) -> None:
        """Look its joint up, and see whether no other one prescribes its motion."""
        super().check(scene)
        together(scene.comm, self.owner, lambda: self.at(self.start))
        if not self.prescribes:
            return
        others = list(scene.named(Motor))
        others.remove(self)  # once: a motor that is named twice is refused, too
        for other in others:
            same = (other.joint, other.acts_along) == (self.joint, self.acts_along)
            both = max(self.since, other.since) < min(self.until, other.until)
            if other.prescribes and same and both:
                raise SceneError(
                    f"{self.owner}: two motors prescribe its {self.acts_along} at the same time, "
                    f"by {self.by} and by {other.by}. Give them windows that do not overlap."
                )


@dataclass(frozen=True)
class JointSpring(OfJoint, Elastic):
    """A spring and a damper along a free coordinate of a joint, such as the angle of a hinge.

    Attributes:
        joint: Name of the joint.
        stiffness: k [N m/rad, or N/m].
        damping: c [N m s/rad, or N s/m].
        rest: Angle [rad] or travel [m] at which the spring has no force.
        along: "angle" or "travel"; needed of a joint that leaves both free.
    """

    is_lasting: ClassVar[bool] = True
    checks: ClassVar[Checks] = OfJoint.checks | Elastic.checks | {"rest": number}

    joint: str
    stiffness: float = 0.0
    damping: float = field(default=0.0, kw_only=True)
    rest: float = field(default=0.0, kw_only=True)
    along: str | None = field(default=None, kw_only=True)

    @property
    def ends_at(self) -> tuple[float, float]:
        """Where it has no force, twice."""
        return float(self.rest), float(self.rest)


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

    is_lasting: ClassVar[bool] = True
    checks: ClassVar[Checks] = (
        OfJoint.checks | Elastic.checks | {"low": number, "high": number, "stiffness": positive}
    )

    joint: str
    low: float | None = None
    high: float | None = None
    stiffness: float = field(kw_only=True)
    damping: float = field(default=0.0, kw_only=True)
    along: str | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Refuse what is no number, ends in the wrong order, and neither end."""
        super().__post_init__()
        if self.low is None and self.high is None:
            raise SceneError(f"{self.owner}: give low, high or both.")
        if not self.ends_at[0] < self.ends_at[1]:
            ends = f"{shown(self.low)} and {shown(self.high)}"
            raise SceneError(f"{self.owner}: low must be below high, got {ends}.")

    @property
    def ends_at(self) -> tuple[float, float]:
        """Both ends, infinite where there is none [rad or m]."""
        low = -inf if self.low is None else float(self.low)
        return low, inf if self.high is None else float(self.high)

    def check(self, scene: Any) -> None:
        """Look its joint up, and warn of degrees."""
        _, name = coordinate_of(scene, self.owner, self.joint, self.along)
        largest = max(abs(end) for end in self.ends_at if isfinite(end))
        if name == "angle" and largest > 4 * pi:
            warn(
                scene.comm,
                f"{self.owner}: its ends are in rad, and {largest:g} is more than two turns. Are "
                "they in degrees? np.radians(…) makes rad of them.",
            )


class Blow(NamedTuple):
    """How a stop, or a cable that is taut, acts in a step."""

    stop: Any  # or cable, with a stiffness and a damping
    effort: float  # size of its force or torque [N, N m]
    force: float  # size of that over the joint's size, where it is a torque [N]
    rate: float  # mean rate of the coordinate [rad/s, m/s]
    pressed: bool  # whether it had most of its elongation at the start of the step


def end_rates(q0: Any, q1: Any, middle: Any, dt: float) -> tuple[Any, Any]:
    """Rates of a path at both ends of a step, by the parabola through three of its values."""
    return (4 * middle - 3 * q0 - q1) / dt, (3 * q1 + q0 - 4 * middle) / dt


def titles_of(scene: Any) -> list[tuple[Any, str]]:
    """Motors, springs and stops of a scene with their titles, which do not change in time.

    The title is the owner, with more words where an owner has several.
    """
    effects = [effect for effect in scene.effects if hasattr(effect, "acts_along")]
    each = [(effect.owner, getattr(effect, "by", effect.acts_along)) for effect in effects]
    owners = [owner for owner, _ in each]
    titles = list(owners)
    for k, (owner, by) in enumerate(each):
        if owners.count(owner) > 1:
            number = f" {each[: k + 1].count((owner, by))}" if each.count((owner, by)) > 1 else ""
            titles[k] = f"{owner}{f', {by}' if by else ''}{number}"
    return list(zip(effects, titles, strict=True))


def efforts_of(scene: Any) -> dict[str, list[str]]:
    """Titles of the motors, springs and stops of each joint of a scene, by the joint's title."""
    every = titles_of(scene)
    return {
        joint.title: [title for effect, title in every if effect.joint == joint.title]
        for joint in scene.named(Joint)
    }


def coordinate_of(scene: Any, owner: str, name: str, along: str | None) -> tuple[Joint, str]:
    """A joint by its name, and its coordinate along; the only one that it leaves free if None.

    Raise `SceneError` if there is no such joint, or it leaves that not free.
    """
    joints = {joint.title: joint for joint in scene.named(Joint)}
    if name not in joints:
        raise SceneError(f"{owner}: there is no joint '{name}'; there are {sorted(joints)}.")
    free = tuple(joints[name].pieces.coordinates)
    if along is None and len(free) == 1:
        along = free[0]
    if along not in free:
        raise SceneError(
            f"{owner}: {joints[name].owner} leaves {' and '.join(free) or 'no single number'} "
            f"free, and {along or 'one of them'} is asked for."
        )
    return joints[name], str(along)
