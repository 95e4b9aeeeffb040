"""Events: freezes and releases, accounted for to the joule."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rigidfx.base.types import Array, Indices


@dataclass(frozen=True)
class BodyChange:
    """A body that was made, changed or released at an event.

    Attributes:
        name: Its name.
        number: Its number.
        cells_before: Its cells before the event; 0 for a new body.
        cells_after: Its cells after the event; 0 for one that is no more.
        stored_before: Strain energy and energy of difference velocities it held before [J].
        stored_after: The same after the event [J].
    """

    name: str
    number: int
    cells_before: int
    cells_after: int
    stored_before: float
    stored_after: float


@dataclass(frozen=True)
class Event:
    """A change of the division at an instant; numbers are summed over ranks.

    Attributes:
        t: Time [s].
        kind: "freeze" if the window's cells became rigid, "release" if bodies were released.
        reason: Its cause, in words.
        changes: The bodies that it changed.
        unknowns_before: Number of unknowns before it.
        unknowns_after: Number of unknowns after it.
        energy_frozen: Energy taken out of the motion and stored in bodies [J].
        energy_released: Stored energy given back to the motion [J].
        energy_lost: Total energy before, and work of supports and motors, less total energy after,
            everything stored counted [J].
        work_of_supports: Work of the impulse that supports exert at the event [J].
        work_of_motors: Work of the impulses by which motors keep their given motion there [J].
        impulse: Impulse of supports on the structure at the event, shape (3,) [N s]: zero with a
            lumped mass; a consistent one couples nodes that they hold to those of bodies.
        angular_impulse: Its moment about the origin, shape (3,) [N m s].
        linear_momentum_error: |L after - L before - impulse| [kg m/s].
        angular_momentum_error: |J after - J before - angular impulse| about the origin [kg m²/s].
        woken: Owned cells on this rank that forces on their bodies would have strained too much;
            the others of a release that they cause lie round them, or could not stay a body.
    """

    t: float
    kind: Literal["freeze", "release"]
    reason: str
    changes: tuple[BodyChange, ...]
    unknowns_before: int
    unknowns_after: int
    energy_frozen: float
    energy_released: float
    energy_lost: float
    work_of_supports: float
    work_of_motors: float
    impulse: Array
    angular_impulse: Array
    linear_momentum_error: float
    angular_momentum_error: float
    woken: Indices = field(default_factory=lambda: np.empty(0, np.int32))
