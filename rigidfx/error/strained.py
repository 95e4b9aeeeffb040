"""Strains of the error motion in rigid cells, and those that wake them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigidfx.base.types import Array

__all__ = ["Limits", "Strained", "part_of"]


@dataclass(frozen=True)
class Limits:
    """Rates that wake cells.

    Attributes:
        rates: Strain rate of e, of each owned cell [1/s]; None on all ranks if none wakes.
        window: Length of a window [s]; infinite while that is not known.
        size: Largest |e| of any node [m].
        part: The same over the largest displacement so far; NaN where rates decide.
        begins: Whether a motion begins from rest.
    """

    rates: Array | None = None
    window: float = np.inf
    size: float = np.inf
    part: float = np.nan
    begins: bool = False


@dataclass(frozen=True)
class Strained:
    """Strains of the error motion in rigid cells; zero in flexible ones.

    Attributes:
        rate: Strain rate of each owned cell, over the rate that wakes it.
        spring: Strain rate at which it would spring into that in the step, were it released, over
            the rate that wakes it.
        strain: Strain of each owned cell [-].
        window: Length of a window [s]; infinite while that is not known.
    """

    rate: Array
    spring: Array
    strain: Array
    window: float = np.inf


def part_of(strain: Array, limit: Array) -> Array:
    """Ratio to a limit; zero is no part of any, and a failed solve exceeds all."""
    out = np.zeros_like(strain)
    some = ~(strain == 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        out[some] = np.nan_to_num(strain[some] / limit[some], nan=np.inf, posinf=np.inf)
    return out
