"""Calls of a step to actions, one of which may be of a user's own: none raises in a step.

Only methods of its kind are called. An exception, or a result that is no number, is kept for all
ranks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.failures import Failures
from rigidfx.base.inputs import number, shown
from rigidfx.effects import Action, Touch

__all__ = ["Heeded", "doing"]

Array = npt.NDArray[np.float64]
T = TypeVar("T")


def doing(actions: Sequence[Action], method: str) -> list[Any]:
    """Those actions whose class does something of its own by a method."""
    return [a for a in actions if getattr(type(a), method) is not getattr(Action, method)]


class Heeded:
    """Functions of those actions that do something of their own by a method."""

    def __init__(self, owners: Mapping[int, str], failures: Failures) -> None:
        """Take over who is who.

        Args:
            owners: Names of actions in messages, by their identities.
            failures: Keeps their exceptions.
        """
        self._owners, self._failures = owners, failures

    def _each(
        self,
        actions: Sequence[Action],
        method: str,
        made: Callable[[str, Callable[..., Any]], Callable[..., T]],
        instead: T,
    ) -> list[Callable[..., T]]:
        def heeded(action: Action) -> Callable[..., T]:
            owner = self._owners[id(action)]
            function = made(owner, getattr(action, method))
            return self._failures.heeded(owner, method, function, lambda *given: instead)

        return [heeded(action) for action in doing(actions, method)]

    def does(self, actions: Sequence[Action], method: str) -> list[Callable[..., None]]:
        """Methods that change arrays given to them."""
        return self._each(actions, method, lambda owner, function: function, None)

    def adds(self, actions: Sequence[Action], method: str) -> list[Callable[..., None]]:
        """Methods that give an array; functions add it to their first argument."""
        return self._each(actions, method, lambda owner, function: partial(_add, function), None)

    def tells(self, actions: Sequence[Action], method: str) -> list[Callable[..., float]]:
        """Methods that give a number."""

        def made(owner: str, function: Callable[..., Any]) -> Callable[..., float]:
            return lambda *given: number(owner, method, function(*given))

        return self._each(actions, method, made, 0.0)

    def answers(self, actions: Sequence[Action], method: str) -> list[Callable[..., bool]]:
        """Methods that give a truth value."""
        return self._each(actions, method, lambda owner, function: function, False)

    def touches(self, contacts: Sequence[Action]) -> list[Callable[..., Touch]]:
        """Touches of each contact."""

        def heeded(contact: Action) -> Callable[..., Touch]:
            owner = self._owners[id(contact)]
            nothing = Touch(contact.title)

            def touch() -> Touch:
                return nothing + contact.touch()

            return self._failures.heeded(owner, "touch", touch, lambda: nothing)

        return [heeded(contact) for contact in contacts]

    def blame(
        self, actions: Sequence[Action], method: str, given: Callable[[Action], Array]
    ) -> None:
        """Keep it for all ranks if forces that an action gives are not finite. Collective.

        Args:
            actions: Actions.
            method: Methods called.
            given: Asks one of them, for its forces.
        """

        def look(action: Action) -> None:
            forces = np.ravel(given(action))
            if not np.isfinite(forces).all():
                worst = shown(forces[np.argmin(np.isfinite(forces))])
                raise ValueError(f"a force of {worst} N")

        for action in doing(actions, method):
            owner = self._owners[id(action)]
            self._failures.heeded(owner, method, look, lambda action: None)(action)


def _add(function: Callable[..., Array], out: Array, *given: Any) -> None:
    out += function(*given)
