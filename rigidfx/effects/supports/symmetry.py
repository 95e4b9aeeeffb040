"""A plane of symmetry."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.effects.supports.support import Fixed

__all__ = ["FLAT", "Symmetry"]

FLAT = 1e-9  # of the size of the mesh


@dataclass(frozen=True)
class Symmetry(Fixed):
    """Holds the nodes of a plane in the direction of its normal, which is x, y or z.

    It is the plane of the nodes after an `InitialDisplacement`.

    Loads, reactions and energies are those of the modelled half. Give half of a force that acts in
    the plane itself. A `RigidFace` that the plane cuts, such as half of a hole, moves along the
    plane and turns about its normal only. A joint of the name "Symmetry on 'plane' - RigidFace
    'hole'" holds it, and tells its force.

    Attributes:
        components: The normal: found by the scene.
    """

    components: str = field(default="xyz", init=False)

    def placed(self, scene: Any) -> Symmetry:
        """The same with the normal of its plane, as that lies at the start. Collective.

        Raises:
            SceneError: If the set is unknown, or no plane with the normal x, y or z.
        """
        nodes = scene.nodes(self.where, self.kind, (2,))
        X = scene.start_places[nodes]
        comm = scene.comm
        ends = [
            comm.allreduce(tuple(map(float, values)), op=op)
            for values, op in (
                (X.min(axis=0, initial=np.inf), _low),
                (X.max(axis=0, initial=-np.inf), _high),
            )
        ]
        extent = np.subtract(ends[1], ends[0])
        size = float(np.max(np.nan_to_num(extent, posinf=0.0, neginf=0.0)))
        flat = np.flatnonzero(extent <= FLAT * max(size, np.abs(ends).max()))
        if len(flat) != 1:
            raise SceneError(
                f"{self.owner}: its facets must lie in one plane whose normal is x, y or z; they "
                f"reach from {ends[0]} to {ends[1]} m at the start."
            )
        out = replace(self)
        object.__setattr__(out, "components", "xyz"[int(flat[0])])
        return out


def _low(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(map(min, a, b))


def _high(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(map(max, a, b))
