"""A run beside a finer one: reports whose ledgers have the error that was measured."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rigidfx.base.types import Array
from rigidfx.report.ledger import Entry
from rigidfx.report.report import Report

__all__ = ["beside"]


KNOWN = 8  # steps of the finer run that are remembered
AHEAD = 2  # of them past the time that is asked, as slopes are taken from neighbours


def beside(
    reports: Iterator[Report], finer: Iterator[Report], names: Sequence[str], budget: float
) -> Iterator[Report]:
    """Reports with the largest distance of probes from where they are in a finer run. Collective.

    The finer run goes along, and ends with them.

    Args:
        reports: Of a run with ledgers.
        finer: Of the other run.
        names: Which probes count.
        budget: Their permitted distance, over the largest displacement.
    """
    known: deque[tuple[float, Array]] = deque(maxlen=KNOWN)
    worst = 0.0
    try:
        for report in reports:
            while sum(t >= report.t for t, _ in known) < AHEAD:
                other = next(finer, None)
                if other is None:
                    break
                known.append((other.t, np.array([other.probes[name] for name in names])))
            now = np.array([report.probes[name] for name in names])
            worst = max(worst, float(np.linalg.norm(now - _at(report.t, known), axis=1).max()))
            assert report.ledger is not None
            scale = report.ledger.time.scale
            measured = Entry(worst, scale, budget * scale, "m")
            yield replace(report, ledger=replace(report.ledger, measured=measured))
    finally:
        for run in (reports, finer):
            run.close()  # type: ignore[attr-defined]


def _at(t: float, known: deque[tuple[float, Array]]) -> Array:
    """Displacements at t [s], by a cubic of the steps around."""
    times, u = np.array([s for s, _ in known]), np.array([place for _, place in known])
    if len(times) < 3:
        return np.asarray(u[int(np.argmin(np.abs(times - t)))])
    from scipy.interpolate import CubicHermiteSpline  # takes 0.1 s to import

    return np.asarray(CubicHermiteSpline(times, u, np.gradient(u, times, axis=0))(t))
