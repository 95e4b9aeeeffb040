"""All that a policy remembers, in one place."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.decide.memory.back_off import BackOff
from rigidfx.decide.memory.contact_changes import ContactChanges
from rigidfx.decide.memory.load_changes import LoadChanges
from rigidfx.decide.memory.signals import Signals
from rigidfx.decide.memory.window import Window

__all__ = ["Memory"]


@dataclass
class Memory:
    """All that a policy remembers.

    Attributes:
        window: The window of observation.
        signals: The motion and the loads since the last change.
        back_off: How long cells have to wait.
        loads: The loads of the present bodies, and the largest so far.
        contacts: The same of contacts.
        next_number: First number that no body has had.
        said: Kinds of warnings that were given.
        largest: Largest strain rate of any cell so far, if tolerances are relative to it [1/s].
    """

    remembered: ClassVar[Remembered] = same("next_number", "said", "largest") | dict.fromkeys(
        ("window", "signals", "back_off", "loads", "contacts"), PART
    )

    window: Window
    signals: Signals
    back_off: BackOff
    loads: LoadChanges
    contacts: ContactChanges
    next_number: int
    said: set[str] = field(default_factory=set)
    largest: float = 0.0
