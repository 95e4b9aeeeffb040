"""A gong: a square plate with a hub in its middle, and two places where a mallet hits it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

import rigidfx as rf

__all__ = ["HUB", "MALLET", "PLACES", "SIDE", "THICK", "gong"]

SIDE, THICK, HUB = 1.0, 0.02, 0.25  # m
MALLET = 0.125  # m, a side of the square that it covers
PLACES = {"corner": (0.25, 0.25), "side": (0.8125, 0.5)}  # m, of its middle

Array = npt.NDArray[np.float64]
EPS = 1e-9  # m


def gong(across: int) -> rf.Domain:
    """One layer of hexahedra in the plane z = 0, a corner of it at the origin. Collective.

    It has the cell sets plate, hub, under corner and under side, and the facets rim, corner and
    side.

    Args:
        across: Cells along a side; a multiple of 16, so that hub and mallet are squares of cells.
    """
    middle = SIDE / 2, SIDE / 2
    out = rf.box((0, 0, 0), (SIDE, SIDE, THICK), (across, across, 1))
    out = out.with_cells("hub", lambda x: _from(middle, x) <= HUB / 2 + EPS)
    out = out.with_cells("plate", lambda x: _from(middle, x) >= HUB / 2 - EPS)
    out = out.with_facets("rim", lambda x: _from(middle, x) >= SIDE / 2 - EPS)
    for name, place in PLACES.items():
        below: Callable[[Array], Array] = partial(_below, place)
        out = out.with_cells(f"under {name}", below)
        out = out.with_facets(name, lambda x, below=below: below(x) & (x[2] >= THICK - EPS))
    return out


def _from(middle: tuple[float, float], x: Array) -> Array:
    """Distance in the plane, the larger of the two along its sides [m]."""
    return np.asarray(np.maximum(abs(x[0] - middle[0]), abs(x[1] - middle[1])))


def _below(place: tuple[float, float], x: Array) -> Array:
    """Which points are below the mallet."""
    return np.asarray(_from(place, x) <= MALLET / 2 + EPS)
