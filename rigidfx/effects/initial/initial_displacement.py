"""Where the motion starts from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.effects.base import Effect
from rigidfx.effects.fields import values_of

__all__ = ["InitialDisplacement"]


@dataclass(frozen=True)
class InitialDisplacement(Effect):
    """Displacement at the start, by a function of the reference position; it strains the body.

    Supports hold, and move, nodes from where it puts them.

    Attributes:
        function: x of shape (3, n) [m] → displacements of shape (3, n) [m].
    """

    function: Callable[[npt.NDArray[np.float64]], npt.ArrayLike]

    def __post_init__(self) -> None:
        """Check the function.

        Raises:
            SceneError: If it is none.
        """
        super().__post_init__()
        if not callable(self.function):
            raise SceneError("InitialDisplacement: function must be a function of x.")

    def check(self, scene: Any) -> None:
        """See whether the function gives finite vectors. Collective."""
        values_of(self.kind, self.function, scene)
