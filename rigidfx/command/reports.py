"""What the reports of a run tell: its freezes and releases, and curves against time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rigidfx.plot import Curve
from rigidfx.report.events import Event
from rigidfx.report.report import Report

__all__ = ["curve", "energy_jump", "events_of", "freezes_of", "line_of"]


def events_of(reports: Iterable[Report]) -> list[Event]:
    """All events of a run."""
    return [event for report in reports for event in report.events]


def freezes_of(reports: Iterable[Report]) -> list[Event]:
    """Those by which something became rigid."""
    return [event for event in events_of(reports) if event.kind == "freeze"]


def energy_jump(reports: Sequence[Report]) -> float:
    """The most that any event lost or gained, relative to the largest energy of the run."""
    largest = max(r.energy for r in reports)
    lost = max((abs(event.energy_lost) for event in events_of(reports)), default=0.0)
    return lost / max(largest, 1e-300)


def line_of(event: Event) -> str:
    """An event in a line."""
    cells = sum(change.cells_after - change.cells_before for change in event.changes)
    return (
        f"t = {event.t:.4g} s: {event.kind} of {abs(cells)} cells, {event.unknowns_before} → "
        f"{event.unknowns_after} unknowns, {event.energy_frozen + event.energy_released:.3g} J "
        f"moved, {event.energy_lost:.1e} J lost ({event.reason})"
    )


def curve(label: str, reports: Sequence[Report], name: str) -> Curve:
    """A number of the reports, by its name, against time."""
    return Curve(label, [r.t for r in reports], [getattr(r, name) for r in reports])
