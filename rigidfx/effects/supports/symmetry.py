"""A plane of symmetry."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from mpi4py import MPI

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
        ends = np.stack([-X.min(axis=0, initial=np.inf), X.max(axis=0, initial=-np.inf)])
        scene.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
        low, high = -ends[0], ends[1]
        extent = high - low
        size = float(np.max(np.nan_to_num(extent, posinf=0.0, neginf=0.0)))
        flat = np.flatnonzero(extent <= FLAT * max(size, np.abs(ends).max()))
        if len(flat) != 1:
            raise SceneError(
                f"{self.owner}: its facets must lie in one plane whose normal is x, y or z; they "
                f"reach from {tuple(low.tolist())} to {tuple(high.tolist())} m at the start."
            )
        out = replace(self)
        object.__setattr__(out, "components", "xyz"[int(flat[0])])
        return out
