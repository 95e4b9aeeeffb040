"""Spent accuracy of a run, against the allowed one, as curves."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigidfx.base.types import Array
from rigidfx.plot.curves import Curve

__all__ = ["spent"]


ENERGIES = {"withheld": "withheld by rigidity", "frozen": "frozen vibration"}


def spent(history: Mapping[str, Array]) -> dict[str, list[Curve]]:
    """The accounts of the ledger in per cent, by panel; nothing where nothing was estimated.

    Args:
        history: The columns of a history.csv by name.
    """
    if not np.isfinite(history.get("deformation", np.array([np.nan]))).any():
        return {}
    t, panels = history["t"], {}
    panels["Energies, % of the energy of deformation"] = _panel(
        t, history, "deformation", ENERGIES, "energy_allowed"
    )
    if np.any(history["damped"] > 0):
        panels["Numerical damping, % of the energy of deformation"] = _panel(
            t, history, "deformation", {"damped": "taken"}, "damping_allowed"
        )
    panels["Time integration, % of the largest displacement"] = _panel(
        t, history, "displacement", {"time_error": "estimated error"}, "time_allowed"
    )
    panels["Rigid parts, % of the largest displacement"] = _panel(
        t, history, "displacement", {"rigidity_error": "estimated error"}, "rigidity_allowed"
    )
    if np.isfinite(history.get("measured_error", np.array([np.nan]))).any():
        # What the one share leaves is the other's: together they are all that was asked.
        budget = history["time_allowed"] + np.nan_to_num(history["rigidity_allowed"])
        panels["All errors, % of the largest displacement"] = _panel(
            t,
            {**history, "budget": budget},
            "displacement",
            {"measured_error": "measured"},
            "budget",
        )
    return {title: curves for title, curves in panels.items() if curves}


def _panel(
    t: Array, h: Mapping[str, Array], scale: str, names: Mapping[str, str], allowed: str
) -> list[Curve]:
    sizes = np.where(h[scale] > 0, h[scale], np.inf)
    every = {**names, allowed: "allowed"}
    known = {
        name: words for name, words in every.items() if name in h and np.isfinite(h[name]).any()
    }
    return [Curve(words, t, 100 * np.nan_to_num(h[name]) / sizes) for name, words in known.items()]
