"""Where the motion starts from.

Effects that say where they act mean the body where it lies at the start: at X plus the
displacements given here, and after a static preload.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.effects.base import Effect
from rigidfx.effects.fields import values_of

__all__ = ["InitialDisplacement", "places_at_start"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class InitialDisplacement(Effect):
    """Displacement at the start, by a function of the reference position; it strains the body.

    Supports start from the displaced positions.

    Attributes:
        function: x of shape (3, n) [m] → displacements of shape (3, n) [m].
        where: Name of a set whose nodes it displaces, of any dimension; all nodes if None.
    """

    function: Callable[[Array], npt.ArrayLike]
    where: str | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check the function.

        Raises:
            SceneError: If it is none.
        """
        super().__post_init__()
        if not callable(self.function):
            raise SceneError("InitialDisplacement: function must be a function of x.")

    def values(self, scene: Any) -> Array:
        """Its displacements per local node with ghosts, shape (nodes, 3) [m]. Collective.

        Raises:
            SceneError: On every rank, if the function gives anything but finite vectors.
        """
        values = values_of(self.kind, self.function, scene)
        return values if self.where is None else values * scene.members(self.where, self.kind)


def places_at_start(scene: Any) -> Array:
    """Places of the local nodes where displacements put them, shape (nodes, 3) [m]. Collective.

    Args:
        scene: The scene, whose space is known already.

    Raises:
        SceneError: On every rank, if a function gives anything but finite vectors.
    """
    given = [effect.values(scene) for effect in scene.named(InitialDisplacement)]
    return np.asarray(sum(given, scene.space.tabulate_dof_coordinates()))
