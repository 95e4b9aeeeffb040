"""How the motion starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import vector
from rigidfx.effects.base import Effect, Vector

__all__ = ["InitialVelocity"]


@dataclass(frozen=True)
class InitialVelocity(Effect):
    """Velocity at the start: a rigid motion, or any function of the reference position.

    Attributes:
        linear: Velocity of the centre [m/s].
        angular: Angular velocity ω [rad/s].
        centre: Point of the rotation [m]; the centre of mass if None.
        function: x of shape (3, n) [m] → velocities of shape (3, n) [m/s], added to the rigid
            motion.
    """

    linear: Vector = (0.0, 0.0, 0.0)
    angular: Vector = (0.0, 0.0, 0.0)
    centre: Vector | None = None
    function: Callable[[npt.NDArray[np.float64]], npt.ArrayLike] | None = None

    def __post_init__(self) -> None:
        """Check the vectors.

        Raises:
            SceneError: If one is not three finite numbers, or `function` is not callable.
        """
        super().__post_init__()
        vector(self, "linear", self.linear)
        vector(self, "angular", self.angular)
        if self.centre is not None:
            vector(self, "centre", self.centre)
        if self.function is not None and not callable(self.function):
            raise SceneError("InitialVelocity: function must be callable.")
