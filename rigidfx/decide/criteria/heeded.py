"""A wrapper for criteria: a user's own may fail on some ranks, or return no numbers.

After a failure nothing becomes rigid, and nothing wakes. All ranks learn of it when they next sum
over the state (`rigidfx.base.failures`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, TypeVar

import numpy as np
from dolfinx import fem

from rigidfx.base.errors import SceneError, together
from rigidfx.base.failures import Failures
from rigidfx.base.inputs import shown
from rigidfx.base.remembered import PART, Remembered
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.decide.criteria.judging import Criterion
from rigidfx.decide.criteria.observation import Observation
from rigidfx.decide.criteria.rule import Rule
from rigidfx.decide.memory.memory import Memory
from rigidfx.error.strained import Limits, Strained
from rigidfx.flexible.indicator import Indicator
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.report.ledger import Rigidity
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline

__all__ = ["heeded_indicator", "heeded_rule"]

T = TypeVar("T")


def heeded_rule(
    criterion: Criterion,
    scene: Scene,
    timeline: Timeline,
    memory: Memory,
    failures: Failures,
) -> Rule:
    """The rule of a criterion; its later exceptions are kept. Collective.

    Args:
        criterion: The criterion.
        scene: The problem.
        timeline: Where steps end.
        memory: Memory of the policy.
        failures: Keeps exceptions of the rule.

    Raises:
        SceneError: On every rank, if the criterion cannot make one.
    """
    owner = type(criterion).__name__
    rule: Any = together(
        scene.comm, f"{owner}: its rule", lambda: criterion.rule(scene, timeline, memory)
    )
    return _Rule(rule, owner, failures, memory.window.worst.size)


def heeded_indicator(
    criterion: Criterion, scene: Scene, forces: InternalForces, failures: Failures
) -> Indicator:
    """The indicator of a criterion; its later exceptions are kept. Collective.

    Args:
        criterion: The criterion.
        scene: The problem.
        forces: Internal forces, whose u₀ and u₁ hold the ends of a step.
        failures: Keeps exceptions of the indicator.

    Raises:
        SceneError: On every rank, if the criterion cannot make one.
    """
    owner = type(criterion).__name__
    indicator = together(
        scene.comm, f"{owner}: its indicator", lambda: criterion.indicator(scene, forces)
    )
    return _Indicator(indicator, owner, failures, scene.owned_cells(None, owner).size)


class _Heeded:
    """Something of a criterion's, whose failures are kept."""

    def __init__(self, given: Any, owner: str, failures: Failures, owned: int) -> None:
        """Keep it.

        Args:
            given: The rule, or the indicator.
            owner: Name of the criterion.
            failures: Keeps exceptions.
            owned: Number of owned cells.
        """
        self._given, self._owner, self._failures, self._owned = given, owner, failures, owned

    def __getattr__(self, name: str) -> Any:
        """Its other members."""
        return getattr(self._given, name)

    def _ask(self, name: str, instead: T, *given: Any, of: Callable[[Any], T] | None = None) -> T:
        """The value of one of its functions or attributes, checked by `of`."""

        def ask(*given: Any) -> T:
            found = getattr(self._given, name)
            found = found(*given) if callable(found) else found
            return found if of is None else of(found)

        return self._failures.heeded(self._owner, name, ask, lambda *given: instead)(*given)

    def _a(self, kind: type[T]) -> Callable[[Any], T]:
        """A check that a value is of a class."""

        def checked(found: Any) -> T:
            if not isinstance(found, kind):
                raise TypeError(f"{shown(found)} is no {kind.__name__}")
            return found

        return checked

    def _of_cells(self, found: Any) -> Array:
        """A check that a value is a number for each owned cell."""
        if np.shape(found) != (self._owned,) or np.isnan(found).any():
            raise SceneError(
                f"{self._owner}: a number is expected of each of a rank's cells, in an array of "
                f"shape ({self._owned},), got {shown(found)}."
            )
        return np.asarray(found)


class _Rule(_Heeded):
    """A rule that lets everything be as it is as soon as it fails: see `Rule`."""

    remembered: ClassVar[Remembered] = {"_given": PART}

    def __init__(self, rule: Rule, owner: str, failures: Failures, owned: int) -> None:
        """Keep it; arguments as of the base."""
        super().__init__(rule, owner, failures, owned)
        self._no_cells = np.zeros(owned, dtype=bool)

    @property
    def tol(self) -> Array:
        return self._ask("tol", np.zeros(self._owned), of=self._of_cells)

    def limits(self) -> Limits:
        no_limit = np.full(self._owned, np.inf)
        return self._ask("limits", Limits(no_limit), of=self._a(Limits))

    @property
    def rigidity(self) -> Rigidity | None:
        return self._ask("rigidity", None, of=self._a(Rigidity | None))  # type: ignore[arg-type]

    def length(self) -> float:
        return self._ask("length", np.nan, of=float)

    def observe(self, seen: Observation) -> None:
        self._ask("observe", None, seen)

    def window_ends(self, seen: Observation, flexible: Bools) -> None:
        self._ask("window_ends", None, seen, flexible)

    def told(self) -> str:
        return self._ask("told", "", of=str)

    def waking(self, strained: Strained, free: Bools) -> Bools:
        return self._ask("waking", self._no_cells, strained, free, of=self._which_cells)

    def _which_cells(self, found: Any) -> Bools:
        """A check that a value is a truth value for each owned cell."""
        return self._of_cells(found).astype(bool)


class _Indicator(_Heeded):
    """An indicator that finds nothing as soon as it fails: see `Indicator`."""

    @property
    def cells(self) -> Indices:
        return self._ask("cells", np.empty(0, np.int32))

    @property
    def values(self) -> Array:
        return self._ask("values", np.zeros(self._owned), of=self._of_cells)

    @property
    def weights(self) -> Array:
        return self._ask("weights", np.zeros(self._owned), of=self._of_cells)

    def bind(
        self, flexible: Cells, between: tuple[fem.Function, fem.Function] | None = None
    ) -> None:
        self._ask("bind", None, flexible, *(() if between is None else (between,)))

    def measure(self, dt: float) -> Array:
        return self._ask("measure", np.empty(0), dt)

    def strains(self) -> Array:
        return self._ask("strains", np.zeros(self._owned), of=self._of_cells)
