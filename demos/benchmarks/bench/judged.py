"""What waking.py says of a run with rigid or reduced parts, by its flexible twin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import basix
import numpy as np

import rigidfx as rf

MOST = 6.0  # tolerances, above which a cell that strains otherwise than in the twin is missed
PROMISED = 2.4  # error over the largest displacement that tol / peak strain rate brings at most
WINDOW = 20  # steps


@dataclass(frozen=True)
class Record:
    """What is kept of a run, step by step; the initial state is in places and tips alone.

    Attributes:
        unknowns: Number of unknowns at the start.
        places: Places of nodes, shape (steps + 1, nodes, 3) [m]; of a twin alone.
        rates: Strain rate of each cell, shape (steps, cells) [1/s].
        bodies: Whether each cell is in a body at the end of each step, of the same shape.
        lost: How fast each cell strains otherwise than in the twin, of the same shape [1/s].
        woken: Cells that forces have woken in each step.
        tips: Displacement of the probe, shape (steps + 1, 3) [m].
        seconds: Processor time of the steps [s].
    """

    unknowns: int
    places: Sequence[np.ndarray]
    rates: np.ndarray
    bodies: np.ndarray
    lost: np.ndarray
    woken: Sequence[np.ndarray]
    tips: np.ndarray
    seconds: float


def judged(twin: Record, ours: Record, tol: float) -> dict[str, float | int]:
    """Shares of cell-windows and of woken cells, as waking.py explains them; tolerance in 1/s."""
    rates, bodies, most = twin.rates, ours.bodies, MOST * tol
    steps, cells = rates.shape
    wrong = bodies & (ours.lost > most)
    lasting = np.vstack([wrong[1:] & wrong[:-1], np.zeros((1, cells), dtype=bool)])
    quiet = both = needed = missed = woken = in_vain = 0
    for first in range(0, steps - WINDOW + 1, WINDOW):
        window = slice(first, first + WINDOW)
        still = (rates[window] <= tol).all(axis=0)
        quiet += int(still.sum())
        both += float(bodies[window, still].mean(axis=0).sum())
        straining = (rates[window] > most).any(axis=0)
        needed += int(straining.sum())
        missed += int((straining & lasting[window].any(axis=0)).sum())
    for step, above in enumerate(ours.woken):
        woken += above.size
        in_vain += int((rates[step : step + 2 * WINDOW, above] <= tol).all(axis=0).sum())
    return {
        "missed": missed / max(needed, 1),
        "woken": woken,
        "in_vain": in_vain / max(woken, 1),
        "share": float(bodies.mean()),
        "quiet_share": quiet / max(steps // WINDOW * cells, 1),
        "of_quiet": both / max(quiet, 1),
    }


def error(twin: Record, ours: Record) -> float:
    """Error of the probe's displacement, over its largest one."""
    size = np.abs(twin.tips - twin.tips[0]).max()
    return float(np.abs(twin.tips - ours.tips).max() / size)


class CellStrains:
    """Green strains at the points of a rule of second order in each cell."""

    def __init__(self, scene: rf.Scene) -> None:
        """Tabulate gradients of the shape functions of a scene's space."""
        element, X = scene.space.element.basix_element, scene.space.tabulate_dof_coordinates()
        points, weights = basix.make_quadrature(element.cell_type, 2)
        by_point = np.moveaxis(element.tabulate(1, points)[1:, :, :, 0], 0, 2)
        self._nodes = scene.space.dofmap.list
        J = np.einsum("cna,qnb->cqab", X[self._nodes], by_point)
        self._gradients = np.einsum("qnb,cqba->cqna", by_point, np.linalg.inv(J))
        volumes = weights * np.abs(np.linalg.det(J))
        self._shares = volumes / volumes.sum(axis=1, keepdims=True)

    def of(self, places: np.ndarray) -> np.ndarray:
        """E for places of nodes, shape (nodes, 3) [m]; of shape (cells, points, 3, 3)."""
        F = np.einsum("cna,cqnb->cqab", places[self._nodes], self._gradients)
        return 0.5 * (np.einsum("cqka,cqkb->cqab", F, F) - np.eye(3))

    def sizes(self, E: np.ndarray) -> np.ndarray:
        """Root of the mean of E:E over each cell."""
        return np.sqrt(np.einsum("cqab,cqab,cq->c", E, E, self._shares))
