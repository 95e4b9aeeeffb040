"""Error against wall time, a panel for each structure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import comm

from rigidfx.plot import figure_of, on_first_rank, save
from rigidfx.plot.curves import DPI

from .labels import colour, place_labels
from .study import SURE, Study


def draw(studies: Sequence[Study], path: Path) -> None:
    """Draw all runs but the references. Collective."""

    def picture() -> None:
        title = "What accuracy costs in time: each point is a run, down and to the left is better"
        figure, axes = figure_of(len(studies), 1, (11.0, 5.2 * len(studies)), title)
        figure.set_dpi(DPI)
        for ax, study in zip(axes[:, 0], studies, strict=True):
            _panel(ax, study)
        figure.draw_without_rendering()  # the layout, on which places in pixels depend
        for ax, study in zip(axes[:, 0], studies, strict=True):
            best = study.front
            place_labels(ax, [*best, *(row for row in study.compared if row not in best)])
        save(figure, path)

    on_first_rank(comm, picture, path.stem)


def _panel(ax: Any, study: Study) -> None:
    """The points of a structure, the line of the best, and what is not known in grey."""
    name, rows = study.structure.name, study.compared
    ax.set(title=name[0].upper() + name[1:], xlabel="time of one core (s)", ylabel="error")
    ax.set(xscale="log", yscale="log")
    walls, errors = ([row[key] for row in rows] for key in ("cpu_s", "error"))
    ax.set_xlim(min(walls) / 1.5, max(walls) * 2.6)
    ax.set_ylim(min(0.08, 50 * min(errors)), 300.0)
    ax.set_yticks([0.1, 1.0, 10.0, 100.0], ["0.1 %", "1 %", "10 %", "100 %"])
    ax.xaxis.set_major_formatter("{x:g}")
    ax.minorticks_off()
    line = np.array([(row["cpu_s"], 100 * row["error"]) for row in study.front])
    ax.plot(*line.T, color="0.85", linewidth=7, solid_capstyle="round", zorder=1)
    if study.doubt:
        ax.axhspan(1e-9, 100 * SURE * study.doubt, color="0.94", zorder=0.5)
    for row in rows:
        shape = {"marker": "*", "markersize": 16} if row["label"] == "base" else {"marker": "o"}
        ax.plot(row["cpu_s"], 100 * row["error"], color=colour(row["label"]), **shape)
