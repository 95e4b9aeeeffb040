"""Which cells are flexible, which form bodies and which go with a support."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rigidfx.base.types import Indices
from rigidfx.effects import Support
from rigidfx.flexible.internal_forces import Cells
from rigidfx.mechanics.bodies import Bodies


@dataclass(frozen=True)
class Hold:
    """The supports in a part that deforms by shapes."""

    frame: Support | None  # the support that the part's frame follows; None if the frame rests
    guides: tuple[Support, ...] = ()  # others, whose motions in the frame are coordinates of shapes


@dataclass(frozen=True)
class Division:
    """A division of the cells, with the bodies."""

    flexible: Cells  # flexible owned cells by subdomain id
    bodies: Bodies  # rigid bodies that move freely
    # Owned cells that move with a support, by subdomain id; None if there are none
    driven_cells: Cells | None
    # Owned nodes that move with a support, by the support's number
    driven_nodes: Mapping[int, Indices]
    # Owned cells of each named part that moves with a support, by the part's number
    clamped: Mapping[int, Indices]
    # The supports in each body that deforms and is held, by the body's name
    held: Mapping[str, Hold] = field(default_factory=dict)

    @property
    def nodes_of_held(self) -> Indices:
        """Owned nodes of the bodies whose frames supports hold."""
        own = (body.nodes for body in self.bodies.of.records if body.name in self.held)
        return np.concatenate([np.empty(0, np.int32), *own])
