"""Result of one accepted step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rigidfx.base.types import Array
from rigidfx.effects import JointReports, SpringDamperReport, Touch
from rigidfx.step.newton.solution import Solution
from rigidfx.step.system.system import Work
from rigidfx.step.watches.judge import Attempt

__all__ = ["StepResult", "result_of"]


@dataclass(frozen=True)
class StepResult:
    """Result of one accepted step.

    Attributes:
        dt: Its length [s].
        solution: How its equations were solved.
        cuts: How often it was cut before it converged.
        work_of_loads: f_ext·Δu [J].
        work_of_supports: Work of the reactions [J].
        dissipated: Energy taken by each kind of damping [J].
        reactions: Force each support exerts on the structure at the midpoint, shape (3,) [N].
        reaction_moments: Its moment about the origin, shape (3,) [N m].
        alternating_impulse: Impulse of supports besides, by velocities that alternate, and its
            moment, shape (2, 3) [N s, N m s].
        touches: Touch of each contact, by its title.
        joints: Force and motion of each joint, by its title.
        spring_dampers: Force and length of each spring between two points, by its title.
    """

    dt: float
    solution: Solution
    cuts: int
    work_of_loads: float
    work_of_supports: float
    dissipated: Mapping[str, float]
    reactions: Mapping[str, Array]
    reaction_moments: Mapping[str, Array]
    alternating_impulse: Array
    touches: Mapping[str, Touch]
    joints: JointReports = field(default_factory=JointReports)
    spring_dampers: Mapping[str, SpringDamperReport] = field(default_factory=dict)


def result_of(attempt: Attempt, work: Work) -> StepResult:
    """Result of a step, or of an attempt."""
    return StepResult(
        dt=attempt.dt,
        solution=attempt.solution,
        cuts=attempt.cuts,
        work_of_loads=work.loads,
        work_of_supports=work.supports,
        dissipated=work.dissipated,
        reactions=work.reactions,
        reaction_moments=work.reaction_moments,
        alternating_impulse=work.alternating_impulse,
        touches=work.touches,
        joints=work.joints,
        spring_dampers=work.spring_dampers,
    )
