"""A published number beside ours."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Found:
    """A number of a run."""

    quantity: str  # its name, with its unit
    published: float  # the published value
    ours: float  # our value
    allowed: float | None = 0.005  # largest error; None if it is shown without a bound
    scale: float | None = None  # the error is relative to it; to the published value if None
    kind: str = "flexible"  # kind of the run: flexible, reduced, rigid or found parts
    unknowns: int | None = None  # number of unknowns in its last step

    @property
    def error(self) -> float:
        """Relative error."""
        return abs(self.ours - self.published) / abs(self.scale or self.published)


Runs = Callable[[bool], Iterator[list[Found]]]


@dataclass(frozen=True)
class Problem:
    """A problem that others publish."""

    source: str  # where it is published
    runs: Runs  # its runs, short or not: the numbers of one after the other


PROBLEMS: dict[str, Problem] = {}  # by name


def problem(name: str, source: str) -> Callable[[Runs], Runs]:
    """Enter a function that yields runs into the problems, with where it is published."""

    def enter(runs: Runs) -> Runs:
        PROBLEMS[name] = Problem(source, runs)
        return runs

    return enter
