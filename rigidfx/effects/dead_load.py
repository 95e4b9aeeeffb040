"""The base of dead loads: a fixed nodal weight times a force in time, fᵢ(t) = wᵢ q(t).

The weights are assembled once per division, those on the nodes of a body to their sums; a step
only evaluates q at its midpoint.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import check_factor, is_function, numbers, scalar, vector
from rigidfx.effects.action import Action, Array, Structure
from rigidfx.effects.base import TimeFunction, Windowed, check_vector

__all__ = ["DeadLoad"]


@dataclass(frozen=True)
class DeadLoad(Windowed):
    """A load whose direction in space does not follow the body.

    Attributes:
        time: Factor as a function of time, such as a `Table`; 1 if None. An attribute
            `breakpoints` of it names instants at which steps must end.
    """

    is_load: ClassVar[bool] = True
    is_dead: ClassVar[bool] = True
    dims: ClassVar[tuple[int, ...]] = (3,)  # of the sets it may act on

    time: TimeFunction | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check window, value and time function.

        Raises:
            SceneError: If one of them cannot be used.
        """
        super().__post_init__()
        value = getattr(self, "value", None)
        if not is_function(value):
            vector(self, "value", value)
        check_factor(self, self.time)

    def intensity(self, t: float) -> Array:
        """Vector q(t), shape (3,), that multiplies the nodal weights; zero outside the window.

        Args:
            t: Time [s].
        """
        if not self.acts(t):
            return np.zeros(3)
        value = getattr(self, "value", (0.0, 0.0, 0.0))
        vector = numbers(value(t) if is_function(value) else value)
        return vector if self.time is None else vector * scalar(self.time(t))

    def weights(self, scene: Any) -> Array:
        """Weight of each local node: area [m²], volume [m³], mass [kg] or share [1]. Collective."""
        raise NotImplementedError

    def moments(self, structure: Structure, weights: Array) -> Array:
        """Σ w and Σ w V over the nodes of each body, shape (bodies, 4). Collective."""
        return structure.moments(weights)

    def check(self, scene: Any) -> None:
        """Look its set up, and see whether its function of time can be used."""
        where = getattr(self, "where", None)
        if where is not None:
            scene.domain.find(where, self.dims, self.kind)
        check_vector(scene, self.owner, self.start, partial(self.intensity, self.start))

    def signal(self, t: float, dt: float) -> Array:
        """The intensity."""
        return self.intensity(t)

    def bind(self, structure: Structure) -> Action:
        """The forces on nodes and bodies."""
        return DeadForces(self, structure)


class DeadForces(Action):
    """A dead load on the nodes of a division, and on its bodies by sums over their nodes."""

    def __init__(self, load: DeadLoad, structure: Structure) -> None:
        """Assemble the weights. Collective.

        Args:
            load: The effect.
            structure: What it acts on.
        """
        self.kind, self._load = load.kind, load
        weights = load.weights(structure.scene)[: structure.scene.owned_nodes]
        self._moments = load.moments(structure, weights)
        self._weights = np.where(structure.own, weights[structure.rows.nodes], 0.0)[:, None]
        self._q: Array = np.zeros(3)

    def set_time(self, t: float, dt: float) -> None:
        """Evaluate q; what a user's function does is checked.

        Raises:
            SceneError: On this rank, if it fails or is not three finite numbers.
        """
        owner = self._load.owner
        try:
            q = self._load.intensity(t)
        except Exception as error:  # whatever a user's function may raise
            raise SceneError(
                f"{owner}: its value or time function failed at t = {t:g} s with "
                f"{type(error).__name__}: {error}"
            ) from error
        if q.shape != (3,) or not np.isfinite(q).all():
            raise SceneError(
                f"{owner}: at t = {t:g} s three finite components are expected, got {q}. "
                "Check its value and time function."
            )
        self._q = q

    def load_nodes(self, forces: Array) -> None:
        """Add w q."""
        if self._q.any():
            forces += self._weights * self._q

    def load_bodies(self, moments: Array, torques: Array) -> None:
        """Add Σ w q and Σ w V qᵀ."""
        if self._q.any():
            moments += self._moments[:, :, None] * self._q
