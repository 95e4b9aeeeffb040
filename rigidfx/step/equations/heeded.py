"""Calls of a step to actions, one of which may be of a user's own: none raises in a step.

An exception, or a result that is no number, is kept for all ranks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from rigidfx.base.failures import Failures
from rigidfx.base.inputs import number, shown
from rigidfx.base.types import Array
from rigidfx.effects import Action, ContactAction, Touch

__all__ = ["Heeded", "doing"]


NUMBERS = ("stored", "taken")  # methods that give a number


def doing(actions: Sequence[Action], method: str) -> list[Any]:
    """Those actions whose class does something of its own by a method."""
    own = [action for action in actions if hasattr(action, method)]
    base = Action if hasattr(Action, method) else ContactAction
    return [a for a in own if getattr(type(a), method) is not getattr(base, method)]


class Heeded:
    """Functions of those actions that do something of their own by a method."""

    def __init__(self, owners: Mapping[int, str], failures: Failures) -> None:
        """Take over who is who.

        Args:
            owners: Names of actions in messages, by their identities.
            failures: Keeps their exceptions.
        """
        self._owners, self._failures = owners, failures

    def call(self, action: Action, method: str) -> Callable[..., Any]:
        """A method, whose exceptions are kept; then it gives nothing."""
        owner, function = self._owners[id(action)], getattr(action, method)
        instead: Any = 0.0 if method in NUMBERS else None

        def told(*given: Any) -> float:
            return number(owner, method, function(*given))

        def touched() -> Touch:
            return Touch(action.title) + function()

        if method == "touch":
            instead = Touch(action.title)
        own = {"touch": touched, **dict.fromkeys(NUMBERS, told)}.get(method, function)
        return self._failures.heeded(owner, method, own, lambda *given: instead)

    def calls(self, actions: Sequence[Action], method: str) -> list[Callable[..., Any]]:
        """The same of all that do something of their own by it."""
        return [self.call(action, method) for action in doing(actions, method)]

    def blame(
        self,
        actions: Sequence[Action],
        method: str,
        given: Callable[[Action], tuple[Array, ...]],
    ) -> None:
        """Keep it for all ranks if forces that an action gives are not finite. Collective.

        Args:
            actions: Actions.
            method: Methods called.
            given: Asks one of them, for its forces.
        """

        def look(action: Action) -> None:
            forces = np.concatenate([np.ravel(part) for part in given(action)])
            if not np.isfinite(forces).all():
                worst = shown(forces[np.argmin(np.isfinite(forces))])
                raise ValueError(f"a force of {worst} N")

        for action in doing(actions, method):
            owner = self._owners[id(action)]
            self._failures.heeded(owner, method, look, lambda action: None)(action)
