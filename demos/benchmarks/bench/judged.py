"""What waking.py says of a run with rigid parts, by the reports of its flexible twin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["KAPPA", "WINDOW", "Record", "costs", "errors", "judged"]

KAPPA = 3.0
WINDOW = 20  # steps
# Of the probe's largest displacement: below, the error is what solvers leave of a step, and the
# quotient of two such numbers says nothing.
LEAST = 1e-4
AFTER = 10  # steps after a switch, whose median is what a step takes without one


@dataclass(frozen=True)
class Record:
    """What is kept of a run, step by step; the initial state is in `tips` alone.

    Attributes:
        unknowns: Number of unknowns at the start.
        rates: Strain rate of each cell, shape (steps, cells) [1/s].
        rigid: Whether each cell is rigid at the end of each step, of the same shape.
        woken: Cells that forces have woken in each step.
        switches: Number of switches in each step.
        tips: Displacement of the probe as it is shown, shape (steps + 1, 3) [m].
        motions: The error motion at the probe, of the same shape [m].
        walls: Wall time of each step [s].
        kept: Whether each step was solved without a new tangent.
    """

    unknowns: int
    rates: np.ndarray
    rigid: np.ndarray
    woken: Sequence[np.ndarray]
    switches: np.ndarray
    tips: np.ndarray
    motions: np.ndarray
    walls: np.ndarray
    kept: np.ndarray

    @property
    def kept_step(self) -> float:
        """Median time of a step on a kept tangent; of any step if each has a new one [s]."""
        return float(np.median(self.walls[self.kept] if self.kept.any() else self.walls))


def judged(twin: Record, ours: Record, tol: float) -> dict[str, float | int]:
    """Shares of cell-windows and of woken cells.

    Args:
        twin: The flexible run.
        ours: The run with rigid parts.
        tol: Tolerance [1/s].
    """
    rates, rigid = twin.rates, ours.rigid
    steps, cells = rates.shape
    quiet = both = needed = missed = woken = in_vain = 0
    for first in range(0, steps - WINDOW + 1, WINDOW):
        window = rates[first : first + WINDOW]
        still = (window <= tol).all(axis=0)
        quiet += int(still.sum())
        both += float(rigid[first : first + WINDOW, still].mean(axis=0).sum())
        crossing = window > 2 * KAPPA * tol
        for cell in np.flatnonzero(crossing.any(axis=0)):
            at = first + int(np.argmax(crossing[:, cell]))
            needed += 1
            missed += bool(rigid[at, cell] and rigid[min(at + 1, steps - 1), cell])
    for step, above in enumerate(ours.woken):
        woken += above.size
        in_vain += int((rates[step : step + 2 * WINDOW, above] <= tol).all(axis=0).sum())
    return {
        "missed": missed / max(needed, 1),
        "woken": woken,
        "in_vain": in_vain / max(woken, 1),
        "rigid_share": float(rigid.mean()),
        "quiet_share": quiet / max(steps // WINDOW * cells, 1),
        "rigid_of_quiet": both / max(quiet, 1),
    }


def errors(twin: Record, ours: Record) -> dict[str, float | None]:
    """Errors of u and u + e at the probe, over its largest displacement, and |e| over that of u.

    The last two are None where e is not known, the last one where it is not worth a quotient.
    """
    size = np.abs(twin.tips - twin.tips[0]).max()
    off = float(np.abs(twin.tips - (ours.tips - ours.motions)).max() / size)
    told = float(np.abs(ours.motions).max() / size)
    left = float(np.abs(twin.tips - ours.tips).max() / size)
    known = told > 0
    return {
        "error": off,
        "error_corrected": left if known else None,
        "told_over_true": told / off if known and max(told, off) >= LEAST else None,
    }


def costs(twin: Record, ours: Record) -> dict[str, float]:
    """Time over that of the twin, and what a step with a switch and the next take besides."""
    near = np.flatnonzero(ours.switches)
    near = np.unique(np.minimum(np.r_[near, near + 1], len(ours.walls) - 1))
    besides = 0.0
    for step in near:
        after = np.setdiff1d(np.arange(step + 1, step + 1 + AFTER), near)
        after = after[after < len(ours.walls)]
        besides += ours.walls[step] - np.median(ours.walls[after]) if after.size else 0.0
    return {
        "time_ratio": float(ours.walls.sum() / twin.walls.sum()),
        "switch_in_steps": float(besides / max(ours.switches.sum(), 1) / twin.kept_step),
    }
