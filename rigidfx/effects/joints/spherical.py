"""Ball joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.effects.joints.face_motion import Sided
from rigidfx.effects.joints.joint import Joint
from rigidfx.effects.joints.pieces import Pieces
from rigidfx.effects.joints.sphere import sphere_of

__all__ = ["Spherical"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Spherical(Joint):
    """A ball joint: both sides share a point and rotate freely about it.

    Without a place, it is at the centre of the ball or socket that the first face of its sides is.
    """

    def shape_of(self, scene: Any, where: str) -> tuple[Array, Array]:
        """Centre of a ball or socket, or middle and axis of a hole or shaft."""
        centre = sphere_of(scene, self.owner, where)
        if centre is not None:
            return centre, np.full(3, np.nan)
        try:
            return super().shape_of(scene, where)
        except SceneError:
            raise SceneError(
                f"{self.owner}: the surface '{where}' is neither a ball nor a socket, whose centre "
                "could be found, nor a hole nor a shaft. Give the joint's place (at)."
            ) from None

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """Point on point."""
        self.meet(pieces, a, b)
