"""Force and motion of joints in a step, from the averages of their sides and the forces on them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rigidfx.base.named import Named, no_such
from rigidfx.base.types import Array
from rigidfx.effects.joints.elements import Blow
from rigidfx.effects.joints.joint import Joint
from rigidfx.effects.joints.sides import GROUND


@dataclass(frozen=True)
class JointReport:
    """Force and motion of a joint in a step; forces are those at its midpoint, in space.

    Attributes:
        place: Place of the joint on its first side at the end of the step, shape (3,) [m].
        force: On its second side, of rows, motors and springs together, shape (3,) [N].
        moment: On its second side about the joint's place, likewise [N m].
        angle: Of the second side about the axis, turns counted [rad]; NaN if it leaves none free.
        travel: Of the second side along the axis [m]; NaN if it leaves none free.
        angle_rate: Mean rate of the angle in the step [rad/s]; NaN likewise.
        travel_rate: Mean rate of the travel [m/s]; NaN likewise.
        efforts: Torque [N m] or force [N] of each motor, spring and stop of the joint that acts, by
            its owner, such as "Motor of 'pin'". Of two with one owner in the scene each has more:
            "Motor of 'pin', torque 2".
        gap: Largest violation of its rows at the end of the step [m].
    """

    place: Array
    force: Array
    moment: Array
    angle: float = np.nan
    travel: float = np.nan
    angle_rate: float = np.nan
    travel_rate: float = np.nan
    efforts: Mapping[str, float] = field(default_factory=dict)
    gap: float = 0.0


@dataclass(eq=False, repr=False)
class JointReports(Mapping[str, JointReport]):
    """Reports of joints by title, each made when it is first asked for.

    Attributes:
        titles: Titles of the joints, in the order of the scene.
        of: Makes the report of a joint by its number.
        total: Sum of the sizes of all multipliers [N].
        later: Titles that are known from the first step on, at t = 0.
        blows: How stops act in the step, by their titles.
    """

    titles: Sequence[str] = ()
    of: Callable[[int], JointReport] | None = None
    total: float = 0.0
    later: Sequence[str] = ()
    blows: Mapping[str, Blow] = field(default_factory=dict)
    _made: dict[str, JointReport] = field(default_factory=dict, init=False)

    def __getitem__(self, title: str) -> JointReport:
        """The report of a joint."""
        if title not in self._made:
            if self.of is None or title not in self.titles:
                raise no_such("report.joints", title, self, self.later)
            self._made[title] = self.of(self.titles.index(title))
        return self._made[title]

    def __iter__(self) -> Iterator[str]:
        """Their titles."""
        return iter(self.titles)

    def __len__(self) -> int:
        """How many there are."""
        return len(self.titles)


def told_of(
    joint: Joint,
    step: tuple[Array, Array, Array],
    free: Mapping[str, tuple[float, float]],
    efforts: Mapping[str, float],
    gap: float,
) -> JointReport:
    """The report of a joint.

    A force on a place acts there; one on a direction d is a couple, d × f.

    Args:
        joint: The joint.
        step: Its averages at the start of the step, their increments, and forces on them, shape
            (averages, 3) each.
        free: Free coordinates: value at the end and mean rate, by name.
        efforts: Torque or force of each motor and spring, by its owner.
        gap: Largest violation of its rows [m].
    """
    start, moved, forces = step
    pieces = joint.pieces
    sides, places = np.array(pieces.sides), np.array([a.is_place for a in pieces.averages])
    side = 0 if joint.b == GROUND else 1  # the ground tells no forces of its own
    sign = 1.0 if side else -1.0
    first = int(np.argmax(places))
    middle = start + 0.5 * moved
    arms = middle - np.where(places[:, None], middle[first], 0.0)
    on = sides == side
    values = {name: value for name, (value, _) in free.items()}
    rates = {f"{name}_rate": rate for name, (_, rate) in free.items()}
    return JointReport(
        place=start[first] + moved[first],
        force=sign * forces[on & places].sum(axis=0),
        moment=sign * np.cross(arms[on], forces[on]).sum(axis=0),
        efforts=Named(f"report.joints[{joint.title!r}].efforts", efforts),
        gap=gap,
        **values,
        **rates,
    )
