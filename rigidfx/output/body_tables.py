"""The tables of bodies: events.csv, what was frozen and released, and bodies.csv, how they move.

Columns of events.csv, a row per body that was frozen, changed or released: t, kind, reason,
unknowns_before, unknowns_after of the event; energy_frozen, energy_released, energy_lost [J],
work_of_supports, work_of_motors at it [J], linear_momentum_error [kg m/s], angular_momentum_error
[kg m²/s]; impulse_x … [N s] and angular_impulse_x … [N m s] that supports exerted at it; name,
number, cells_before, cells_after, stored_before, stored_after of the body [J].

Columns of bodies.csv, a row per body at each time of the fields: t, number, name, cells, shapes,
nu (see `BodyReport`), mass [kg], centre_x … of mass [m], velocity_x … of it [m/s],
angular_velocity_x … [rad/s], rotation_x …, the rotation vector since the body became rigid [rad],
kinetic, stored, strain [J].
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from scipy.spatial.transform import Rotation

from rigidfx.output.history import components
from rigidfx.report.report import BodyReport, Report

__all__ = ["BODY_COLUMNS", "EVENT_COLUMNS", "body_rows", "event_rows"]

EVENT = (
    *("t", "kind", "reason", "unknowns_before", "unknowns_after"),
    *("energy_frozen", "energy_released", "energy_lost", "work_of_supports", "work_of_motors"),
    *("linear_momentum_error", "angular_momentum_error"),
)
CHANGE = ("name", "number", "cells_before", "cells_after", "stored_before", "stored_after")
IMPULSES = ("impulse", "angular_impulse")
EVENT_COLUMNS = (*EVENT, *(f"{name}_{axis}" for name in IMPULSES for axis in "xyz"), *CHANGE)

BODY = ("number", "name", "cells", "shapes", "nu", "mass")
VECTORS = ("centre", "velocity", "angular_velocity", "rotation")
ENERGIES = ("kinetic", "stored", "strain")
BODY_COLUMNS = ("t", *BODY, *(f"{v}_{axis}" for v in VECTORS for axis in "xyz"), *ENERGIES)


def event_rows(report: Report) -> Iterator[dict[str, Any]]:
    """Rows of events.csv for the switches around a step."""
    for event in report.events:
        of_event = {name: getattr(event, name) for name in EVENT}
        for name in IMPULSES:
            of_event |= components(name, getattr(event, name))
        for change in event.changes:
            yield of_event | {name: getattr(change, name) for name in CHANGE}


def body_rows(report: Report) -> Iterator[dict[str, Any]]:
    """Rows of bodies.csv for the bodies of a report."""
    for body in report.bodies:
        row = {name: getattr(body, name) for name in (*BODY, *ENERGIES)}
        for name in VECTORS:
            row |= components(name, _vector(body, name))
        yield {"t": report.t} | row


def _vector(body: BodyReport, name: str) -> Any:
    if name == "rotation":
        return Rotation.from_matrix(body.orientation).as_rotvec()
    return getattr(body, name)
