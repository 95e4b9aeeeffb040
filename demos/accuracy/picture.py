"""Error against time, a panel for each structure and a curve for each way to choose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from common import comm
from matplotlib.ticker import LogLocator

from rigidfx.plot import figure_of, on_first_rank, save
from rigidfx.plot.curves import DPI

Row = Mapping[str, Any]
COLOURS = {
    "all flexible": "0.45",
    "rigid parts by hand": "#d55e00",
    "asked for": "#0072b2",
    "parts reduced by name": "#009e73",
}


def draw(panels: Mapping[str, Sequence[Row]], path: Path) -> None:
    """Draw the curves. Collective.

    Args:
        panels: Title → rows with `way`, `cpu_s`, `error`, and `asked` (0 if nothing is).
        path: The file.
    """

    def picture() -> None:
        title = "Error against computing time: down and to the left is better"
        figure, axes = figure_of(1, len(panels), (4.6 * len(panels), 4.4), title)
        figure.set_dpi(DPI)
        for ax, (name, rows) in zip(axes[0], panels.items(), strict=True):
            _panel(ax, name, rows)
        axes[0, 0].set_ylabel("error of the probe (%)")
        axes[0, 0].legend(frameon=False, loc="lower left")
        save(figure, path)

    on_first_rank(comm, picture, path.stem)


def _panel(ax: Any, name: str, rows: Sequence[Row]) -> None:
    ax.set(title=name, xlabel="time of one core (s)", xscale="log", yscale="log")
    for way, colour in COLOURS.items():
        if not (along := [row for row in rows if row["way"] == way]):
            continue
        x, y = ([row[key] for row in along] for key in ("cpu_s", "percent"))
        ax.plot(x, y, marker="o", color=colour, linewidth=2.5, label=way)
        for k, row in enumerate(row for row in along if row["asked"]):
            text, place = f"{100 * row['asked']:g} % asked", (row["cpu_s"], row["percent"])
            beside = 7, 8 - 12 * (k % 2)  # in turn above and below
            ax.annotate(text, place, beside, textcoords="offset points", color=colour)
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.minorticks_off()
    ax.margins(0.25)
