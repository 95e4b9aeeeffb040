"""All that a policy remembers, in one place."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.decide.memory.back_off import BackOff
from rigidfx.decide.memory.bends import Bends
from rigidfx.decide.memory.compliance import Compliance
from rigidfx.decide.memory.contact_changes import ContactChanges
from rigidfx.decide.memory.drift import Drift
from rigidfx.decide.memory.load_changes import LoadChanges
from rigidfx.decide.memory.signals import Signals
from rigidfx.decide.memory.strokes import Strokes
from rigidfx.decide.memory.trial import Trial
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
        compliance: What parts named rigid take from it.
        said: Kinds of warnings that were given.
        strokes: Largest strains and rates so far.
        bends: How far the structure deflects, and parts of it bend.
        drift: What rigid parts do to the phases of a free motion.
        trial: Whether the last freeze will last.
        largest: Largest strain rate of any cell so far, if tolerances are relative to it [1/s].
    """

    remembered: ClassVar[Remembered] = same("next_number", "said", "largest") | dict.fromkeys(
        ("window", "signals", "back_off", "loads", "contacts", "compliance"), PART
    )

    window: Window
    signals: Signals
    back_off: BackOff
    loads: LoadChanges
    contacts: ContactChanges
    next_number: int
    strokes: Strokes
    bends: Bends
    drift: Drift
    trial: Trial
    compliance: Compliance = field(default_factory=Compliance)
    said: set[str] = field(default_factory=set)
    largest: float = 0.0
