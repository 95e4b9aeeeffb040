"""Limits of what bodies may withhold, beyond which they grow or cells wake."""

from dataclasses import dataclass

import numpy as np

from rigidfx.base.types import Array


@dataclass(frozen=True)
class Limits:
    """What bodies may withhold."""

    # Strain rate, of each owned cell [1/s]; None on all ranks if none is bounded
    rates: Array | None = None
    # Largest displacement of any node over the length of the budget; NaN where rates decide
    part: float = np.nan
    begins: bool = False  # whether a motion begins from rest


def part_of(strain: Array, limit: Array) -> Array:
    """Ratio to a limit; zero is no part of any, and a failed solve exceeds all."""
    out = np.zeros_like(strain)
    some = ~(strain == 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        out[some] = np.nan_to_num(strain[some] / limit[some], nan=np.inf, posinf=np.inf)
    return out
