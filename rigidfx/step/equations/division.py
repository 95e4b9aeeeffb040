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
    """The supports in a part that deforms by shapes.

    Attributes:
        frame: The support that the part's frame follows; None if the frame rests.
        guides: Others, whose motions in the frame are coordinates of shapes.
    """

    frame: Support | None
    guides: tuple[Support, ...] = ()


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
        held: The supports in each body that deforms and is held, by the body's name.
    """

    flexible: Cells
    bodies: Bodies
    driven_cells: Cells | None
    driven_nodes: Mapping[int, Indices]
    clamped: Mapping[int, Indices]
    held: Mapping[str, Hold] = field(default_factory=dict)

    @property
    def nodes_of_held(self) -> Indices:
        """Owned nodes of the bodies whose frames supports hold."""
        own = (body.nodes for body in self.bodies.of.records if body.name in self.held)
        return np.concatenate([np.empty(0, np.int32), *own])
