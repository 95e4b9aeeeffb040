"""Instants at which forces and paths that depend on time are looked at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rigidfx.effects import Effect, Windowed

__all__ = ["instants"]

# Beside the breakpoints: a force that moves along a part is known at each twentieth of its way.
INSTANTS = 20


def instants(effects: Sequence[Effect], span: tuple[float, float]) -> npt.NDArray[np.float64]:
    """Instants while all of some effects act, sorted; none if they do not act together [s].

    Args:
        effects: The effects.
        span: From when to when [s].
    """
    start, end = span
    for effect in effects:
        if isinstance(effect, Windowed):
            start, end = max(start, effect.since), min(end, effect.until)
    if not start < end:
        return np.empty(0)
    kinks = [t for effect in effects for t in effect.breakpoints if start <= t < end]
    # Parts of the golden section, which are no multiples of a period.
    parts = np.modf((np.arange(INSTANTS) + 0.5) * (np.sqrt(5) - 1) / 2)[0]
    return np.unique(np.r_[start, start + (end - start) * parts, kinks])
