"""The errors of all problems in one picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl

__all__ = ["draw_errors"]

LEAST = 1e-8  # error that is drawn at the left edge
MARKS = {"flexible": "o", "reduced": "s", "rigid": "^", "found": "D"}


def draw_errors(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw each number's error against its bound, a line for each problem."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    names = list(dict.fromkeys(row["problem"] for row in rows))[::-1]
    figure, axes = plt.subplots(figsize=(8, 1.2 + 0.3 * len(names)), layout="constrained")
    for kind, mark in MARKS.items():
        own = [row for row in rows if row["kind"] == kind and row["allowed"] is not None]
        x = [max(row["error"], LEAST) for row in own]
        axes.plot(x, [names.index(row["problem"]) for row in own], mark, label=kind, alpha=0.7)
    bounded = [row for row in rows if row["allowed"] is not None]
    places = [names.index(row["problem"]) for row in bounded]
    axes.plot([row["allowed"] for row in bounded], places, "k|", markersize=12, label="bound")
    axes.set(xscale="log", xlabel="relative error", yticks=range(len(names)), yticklabels=names)
    figure.legend(loc="outside upper center", ncols=5, fontsize="small")
    figure.savefig(path, dpi=120)
    plt.close(figure)
