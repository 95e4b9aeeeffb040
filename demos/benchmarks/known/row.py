"""A published number beside ours."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Found:
    """A number of a run.

    Attributes:
        quantity: Its name, with its unit.
        published: The published value.
        ours: Our value.
        allowed: Largest error; None if it is shown without a bound.
        scale: The error is relative to it; to the published value if None.
        kind: Kind of the run: flexible, reduced, rigid or found parts.
        unknowns: Number of unknowns in its last step.
    """

    quantity: str
    published: float
    ours: float
    allowed: float | None = 0.005
    scale: float | None = None
    kind: str = "flexible"
    unknowns: int | None = None

    @property
    def error(self) -> float:
        """Relative error."""
        return abs(self.ours - self.published) / abs(self.scale or self.published)


Runs = Callable[[bool], Iterator[list[Found]]]


@dataclass(frozen=True)
class Problem:
    """A problem that others publish.

    Attributes:
        source: Where it is published.
        runs: Its runs, short or not: the numbers of one after the other.
    """

    source: str
    runs: Runs


PROBLEMS: dict[str, Problem] = {}  # by name


def problem(name: str, source: str) -> Callable[[Runs], Runs]:
    """Enter a function that yields runs into the problems, with where it is published."""

    def enter(runs: Runs) -> Runs:
        PROBLEMS[name] = Problem(source, runs)
        return runs

    return enter
