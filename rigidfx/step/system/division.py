"""Which cells are flexible, which form bodies and which go with a support."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx.flexible.internal_forces import Cells
from rigidfx.mechanics.bodies import Bodies

__all__ = ["Division"]

Indices = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Division:
    """A division of the cells, with the bodies.

    Attributes:
        flexible: Flexible owned cells by subdomain id.
        bodies: Rigid bodies that move freely.
        driven_cells: Owned cells that move with a support, by subdomain id; None if there are
            none.
        driven_nodes: Owned nodes that move with a support, by the support's number.
        clamped: Owned cells of each named part that moves with a support, by the part's number.
    """

    flexible: Cells
    bodies: Bodies
    driven_cells: Cells | None
    driven_nodes: Mapping[int, Indices]
    clamped: Mapping[int, Indices]
