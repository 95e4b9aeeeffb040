"""What the runs of a structure tell: a row each, the best of them, the reference's own error."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from functools import cached_property

import numpy as np

from .errors import differences
from .plans import COARSER, MESH, REFERENCE
from .runs import History
from .structure import Structure

TELLING = REFERENCE, COARSER, MESH
SURE = 3  # times the reference's own error, above which errors are known
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
            "cpu_s": sum(history["cpu"]),
            **self._differences(label, REFERENCE),
            "change_from_base": self._differences(label, "base")["error"],
        }

    def _differences(self, one: str, other: str) -> dict[str, float]:
        return differences(self.structure, self.histories[one], self.histories[other])

    @property
    def compared(self) -> list[Row]:
        """All runs but those that tell of errors only."""
        return [row for label, row in self.rows.items() if label not in TELLING]

    @cached_property
    def front(self) -> list[Row]:
        """The runs that no other run beats in both time and error, the fastest first."""
        best: list[Row] = []
        for candidate in sorted(self.compared, key=lambda row: row["cpu_s"]):
            if not best or candidate["error"] < best[-1]["error"]:
                best.append(candidate)
        return best

    @cached_property
    def doubt(self) -> float | None:
        """Estimate of the reference's own error by its Δt, which is of second order."""
        if COARSER not in self.histories:
            return None
        return self._differences(COARSER, REFERENCE)["error"] / 3

    @cached_property
    def away(self) -> float | None:
        """Estimate of how far off the reference's probe is, over what budgets are parts of."""
        if COARSER not in self.histories:
            return None
        return self._differences(COARSER, REFERENCE)["distance"] / 3

    @cached_property
    def mesh(self) -> float | None:
        """What half of the cells' size changes, which is in no error.

        All three have edges that bend inwards, where second-order cells are far from their order
        (of an L in plane strain the first frequency converged with order 1.1): as much may be left.
        """
        if MESH not in self.histories:
            return None
        return self._differences("all flexible", MESH)["error"]

    def choice(self, target: float) -> Row | None:
        """The fastest run with an error up to a target, and its time relative to the base's."""
        good = [row for row in self.front if row["error"] <= target]
        if not good:
            return None
        time = good[0]["cpu_s"]
        return {
            **{key: good[0][key] for key in ("label", "cpu_s", "unknowns_integral", "error")},
            "time_to_base": time / self.rows["base"]["cpu_s"],
            "time_to_flexible_base": time / self.rows["all flexible"]["cpu_s"],
            "known": good[0]["error"] > SURE * (self.doubt or 0.0),
        }


def written_as_csv(rows: Sequence[Row]) -> str:
    """Rows with the same keys as the text of a CSV file."""
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
