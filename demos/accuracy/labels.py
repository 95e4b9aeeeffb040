"""Labels of many points, placed where there is room."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from .study import Row

KNOBS = {  # how labels begin → colour
    "base": "#222222",
    "all flexible": "#d55e00",
    "flexible": "#d55e00",
    "automatic": "#56b4e9",
    "tolerance": "#d55e00",
    "window": "#d55e00",
    "Δt": "#0072b2",
    "order 2": "#009e73",
    "mesh": "#009e73",
    "consistent": "#009e73",
    "damping": "#cc79a7",
    "no damping": "#cc79a7",
    "Newton": "#888888",
}
PIXELS = np.array([14, 26, 40, 56, 74, 94, 116, 140, 170, 200])  # how far a label may be away
ANGLES = np.pi * np.array([0, 1, 0.1, -0.1, 0.9, -0.9, 0.25, -0.25, 0.75, -0.75, 0.4, -0.4])


def colour(label: str) -> str:
    """The colour of the knob that a label names first."""
    return next(c for knob, c in KNOBS.items() if label.startswith(knob))


def place_labels(ax: Any, rows: list[Row]) -> None:
    """Write each run's label near its point where there is room, and join the two if it is far.

    Args:
        ax: Axes with their final limits.
        rows: Runs, shown at (time, error in %); the first have the choice.
    """
    points = ax.transData.transform([(r["cpu_s"], 100 * r["error"]) for r in rows])
    taken = [(x - 8, y - 8, x + 8, y + 8) for x, y in points]
    frame = ax.get_window_extent()
    for (x, y), r in zip(points, rows, strict=True):
        text = ax.text(x, y, r["label"], transform=None, fontsize=10, color=colour(r["label"]))
        text.set_in_layout(False)  # the axes are to stay where they are
        size = text.get_window_extent()
        for away, angle in product(PIXELS, ANGLES):
            dx, dy = away * np.cos(angle), away * np.sin(angle)
            left, middle = x + dx - (size.width if dx < 0 else 0), y + dy
            low, high = middle - 0.55 * size.height, middle + 0.55 * size.height
            right = left + size.width
            inside = frame.x0 < left and right < frame.x1 and frame.y0 < low and high < frame.y1
            if inside and not any(
                left < b[2] and b[0] < right and low < b[3] and b[1] < high for b in taken
            ):
                break
        taken.append((left, low, right, high))
        text.set(x=left, y=middle, verticalalignment="center_baseline")
        if away > PIXELS[0]:
            end = ax.transData.inverted().transform((x + dx, y + dy))
            start = r["cpu_s"], 100 * r["error"]
            ax.plot(*zip(start, end, strict=True), color="0.75", linewidth=0.8, zorder=1.5)
