"""Releases that a user asks for: a record."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, shown
from rigidfx.base.taken import taken


@dataclass(frozen=True)
class Release:
    """Bodies become flexible again, at given times or on a condition.

    It is not needed for waking by forces, nor for changes of supports or (`wake="all"`) of loads.

    Attributes:
        at: Times [s] at which steps end and bodies are released.
        when: A function of the report of a step that says whether to release after it: True or
            False, or the names of bodies.
        repeat: If True, the step in which the condition becomes true is solved again with these
            cells flexible (Fig. 2). If False, they are released after that step. With True the
            condition is evaluated before and after each step is accepted; the report before it has
            no events, ledger and recovered stresses.
        where: Name of a set of cells to be released; the rest of their bodies stays rigid. All
            cells if None.
    """

    at: Sequence[float] | float = ()
    when: Callable[[Any], bool | Iterable[str]] | None = None
    where: str | None = None
    repeat: bool = False

    def __post_init__(self) -> None:
        """Check the record.

        Raises:
            SceneError: If there is neither a time nor a condition, or one cannot be used.
        """
        at: Any = taken(self.at)
        several = isinstance(at, Iterable) and not isinstance(at, (str, bytes, Mapping))
        times = tuple(at) if several else (at,)
        for t in times:
            if not number("Release", "at", t) > 0:
                raise SceneError(f"Release: at must be later than the start, got {shown(t)}.")
        object.__setattr__(self, "at", tuple(number("Release", "at", t) for t in times))
        if self.where is not None and not isinstance(self.where, str):
            raise SceneError(f"Release: where must be the name of a set, got {shown(self.where)}.")
        if self.when is not None and not callable(self.when):
            raise SceneError(
                f"Release: when must be a function of a report, got {shown(self.when)}."
            )
        if not isinstance(self.repeat, bool) or (self.repeat and self.when is None):
            raise SceneError(
                "Release: repeat must be True or False, and goes with a condition (when), got "
                f"{shown(self.repeat)}."
            )
        if not self.times and self.when is None:
            raise SceneError("Release: name a time (at) or a condition (when).")

    @property
    def times(self) -> tuple[float, ...]:
        """The times [s]."""
        return self.at  # type: ignore[return-value]
