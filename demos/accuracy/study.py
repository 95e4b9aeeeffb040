"""What the runs of a structure tell: a row each, the best of them, the reference's own error."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from functools import cached_property

import numpy as np

from .errors import differences
from .runs import History
from .structure import Structure

Row = dict[str, "str | float"]


class Study:
    """The runs of a structure, compared.

    Attributes:
        structure: What was run.
        histories: Label → history.
        rows: Label → the run in numbers, in the order of the histories.
    """

    def __init__(self, structure: Structure, histories: dict[str, History]) -> None:
        """Compare all runs with the reference and with the base."""
        self.structure, self.histories = structure, histories
        self.rows: dict[str, Row] = {label: self._row(label) for label in histories}

    def _row(self, label: str) -> Row:
        history, setting = self.histories[label], self.structure.settings[label]
        return {
            "structure": self.structure.name,
            "label": label,
            **asdict(setting),
            "steps": len(history["t"]) - 1,
            "newton_iterations": sum(history["newton"]),
            "unknowns_start": history["unknowns"][1],
            "unknowns_end": history["unknowns"][-1],
            "unknowns_integral": float(np.dot(history["unknowns"], history["dt"])),  # s
            "wall_s": sum(history["wall"]),
            **self._differences(label, "reference"),
            "change_from_base": self._differences(label, "base")["error"],
        }

    def _differences(self, one: str, other: str) -> dict[str, float]:
        return differences(self.structure, self.histories[one], self.histories[other])

    @property
    def compared(self) -> list[Row]:
        """All runs but the reference."""
        return [row for label, row in self.rows.items() if label != "reference"]

    @cached_property
    def front(self) -> list[Row]:
        """The runs that no other run beats in both time and error, the fastest first."""
        best: list[Row] = []
        for candidate in sorted(self.compared, key=lambda row: row["wall_s"]):
            if not best or candidate["error"] < best[-1]["error"]:
                best.append(candidate)
        return best

    @cached_property
    def doubt(self) -> float | None:
        """Estimate of the reference's own error.

        All three have edges that bend inwards, where second-order cells are far from their order
        (of an L in plane strain the first frequency converged with order 1.1): what halving the
        cells of the base changed may be as much as what is left. Then the base with these cells
        differs from the reference by its Δt, of second order, and by what is rigid.
        """
        if "mesh / 2" not in self.histories:
            return None
        settings = self.structure.settings
        steps = (settings["base"].dt / settings["reference"].dt) ** 2
        mesh = self._differences("base", "mesh / 2")
        time = self._differences("mesh / 2", "reference")
        return mesh["error"] + time["error"] / (steps - 1)

    def choice(self, target: float) -> Row | None:
        """The fastest run with an error up to a target, and its time relative to the base's."""
        good = [row for row in self.front if row["error"] <= target]
        if not good:
            return None
        wall = good[0]["wall_s"]
        return {
            **{key: good[0][key] for key in ("label", "wall_s", "unknowns_integral", "error")},
            "time_to_base": wall / self.rows["base"]["wall_s"],
            "time_to_flexible_base": wall / self.rows["all flexible"]["wall_s"],
            "below_reference_error": good[0]["error"] < (self.doubt or 0.0),
        }


def written_as_csv(rows: Sequence[Row]) -> str:
    """Rows with the same keys as the text of a CSV file."""
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
