"""Result of one accepted step."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.step.newton.solution import Solution
from rigidfx.step.system.system import Work
from rigidfx.step.watches.judge import Attempt

__all__ = ["StepResult", "result_of"]


@dataclass(frozen=True, kw_only=True)
class StepResult(Work):
    """Result of one accepted step, or of a load step.

    Attributes:
        dt: Its length [s].
        solution: How its equations were solved.
        cuts: How often it was cut before it converged.
    """

    dt: float
    solution: Solution
    cuts: int


def result_of(attempt: Attempt, work: Work) -> StepResult:
    """Result of a step, or of an attempt."""
    return StepResult(**vars(work), dt=attempt.dt, solution=attempt.solution, cuts=attempt.cuts)
