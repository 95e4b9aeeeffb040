"""Factors of displacements in pictures, given or found."""

from __future__ import annotations

from collections.abc import Iterable
from math import floor, log10
from typing import Any, Literal

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import positive, shown
from rigidfx.base.types import Array

__all__ = ["SHOWN", "Scale", "check_scale", "factor_of"]

SHOWN = 0.1  # largest displacement that is drawn, over the diagonal of the body
Scale = float | Literal["auto"]


def check_scale(owner: str, scale: Any) -> Scale:
    """Check a factor.

    Args:
        owner: Whose factor it is, for the message.
        scale: The given value.

    Raises:
        SceneError: If it is neither a number > 0 nor "auto".
    """
    if isinstance(scale, str):
        if scale != "auto":
            raise SceneError(f"{owner}: scale must be a number > 0 or 'auto', got {shown(scale)}.")
        return "auto"
    return positive(owner, "scale", scale)


def factor_of(
    scale: Scale,
    points: Array,
    displacements: Iterable[Array],
) -> float:
    """The factor; if it is to be found, 1, 2 or 5 times a power of ten, and 1 at least.

    The largest displacement is then drawn as at most a tenth of the diagonal of the body.

    Args:
        scale: A checked factor.
        points: Of the undeformed body, shape (points, 3) [m].
        displacements: Of these points, at several times [m].
    """
    if scale != "auto":
        return scale
    largest = max((float(np.linalg.norm(u, axis=1).max()) for u in displacements), default=0.0)
    if largest == 0.0:
        return 1.0
    wanted = SHOWN * float(np.linalg.norm(np.ptp(points, axis=0))) / largest
    power = 10 ** floor(log10(wanted))
    return max(1.0, max(step * power for step in (1, 2, 5) if step * power <= wanted))
