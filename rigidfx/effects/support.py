"""The base of all supports: the components that they hold, and questions about the motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import isfinite
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.effects.base import Windowed, check_vector

__all__ = ["Support"]


@dataclass(frozen=True)
class Support(Windowed):
    """Prescribes components of the motion of a named set's nodes.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        components: Which of the components x, y, z are held, for example "xz".
    """

    is_load: ClassVar[bool] = True
    holds: ClassVar[bool] = True
    moves: ClassVar[bool] = False  # whether its motion is a user's function of time

    where: str
    components: str = "xyz"

    def __post_init__(self) -> None:
        """Check window and components.

        Raises:
            SceneError: If components is no text, empty, or names anything but x, y, z once each.
        """
        super().__post_init__()
        c = self.components
        if not isinstance(c, str) or not c or set(c) - set("xyz") or len(set(c)) != len(c):
            raise SceneError(
                f"{type(self).__name__} on '{self.where}': components must be some of 'xyz', "
                f"each once, got {c!r}."
            )

    @property
    def axes(self) -> tuple[int, ...]:
        """The held components as numbers 0, 1, 2."""
        return tuple("xyz".index(c) for c in self.components)

    def displacement_at(self, t: float) -> npt.NDArray[np.float64]:
        """Prescribed displacement, shape (3,) [m], up to a constant of no consequence."""
        raise NotImplementedError

    def velocity_at(self, t: float, dt: float) -> npt.NDArray[np.float64]:
        """Prescribed velocity just after t, shape (3,) [m/s].

        Args:
            t: Time [s].
            dt: Time step [s], the scale of the difference quotient where one is needed.
        """
        raise NotImplementedError

    def same_motion(self, other: Support) -> bool:
        """Whether both prescribe the same motion, so that they may share nodes."""
        raise NotImplementedError

    def check(self, scene: Any) -> None:
        """See whether its path can be used; the scene knows its nodes already."""
        start = self.since if isfinite(self.since) else 0.0
        check_vector(scene, self.owner, start, partial(self.displacement_at, start))
        check_vector(scene, self.owner, start, partial(self.velocity_at, start, 1.0))

    def check_run(self, scene: Any, t_end: float) -> None:
        """See whether its motion can be used in a run; by itself it can. Collective.

        Args:
            scene: The scene that names it.
            t_end: When the run ends [s].

        Raises:
            SceneError: On every rank, if it cannot.
        """
