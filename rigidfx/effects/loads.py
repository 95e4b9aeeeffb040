"""Loads that keep their direction in space: dead loads on nodes, resultants on rigid bodies.

A dead load is a fixed nodal weight times a force in time, fᵢ(t) = wᵢ q(t); the weights are
assembled once and a step only evaluates q at its midpoint.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from rigidfx.base.inputs import check_factor, numbers, scalar, vector
from rigidfx.effects.base import WHOLE, TimeFunction, Vector, Windowed

__all__ = ["BodyForce", "DeadLoad", "Gravity", "NodalForce", "Resultant", "Traction"]


@dataclass(frozen=True)
class DeadLoad(Windowed):
    """A load whose direction in space does not follow the body.

    Attributes:
        time: Factor as a function of time, such as a `Table`; 1 if None. An attribute
            `breakpoints` of it names instants at which steps must end.
    """

    time: TimeFunction | None = field(default=None, kw_only=True)

    def intensity(self, t: float) -> npt.NDArray[np.float64]:
        """Vector q(t), shape (3,), that multiplies the nodal weights; zero outside the window.

        Args:
            t: Time [s].
        """
        if not self.active(t):
            return np.zeros(3)
        value = getattr(self, "value", (0.0, 0.0, 0.0))
        vector = numbers(value(t) if callable(value) else value)
        return vector if self.time is None else vector * scalar(self.time(t))

    def __post_init__(self) -> None:
        """Check window, value and time function.

        Raises:
            SceneError: If one of them cannot be used.
        """
        super().__post_init__()
        value = getattr(self, "value", None)
        if not callable(value):
            vector(self, "value", value)
        check_factor(self, self.time)


@dataclass(frozen=True)
class Traction(DeadLoad):
    """Dead traction on named facets, per reference area [Pa].

    Attributes:
        where: Name of a set of facets.
        value: Three components [Pa], or a function of time giving them.
    """

    where: str
    value: Vector | Callable[[float], Vector]


@dataclass(frozen=True)
class NodalForce(DeadLoad):
    """A total force spread in equal parts over the nodes of a named set.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        value: Three components of the *total* force [N], or a function of time giving them.
    """

    where: str
    value: Vector | Callable[[float], Vector]


@dataclass(frozen=True)
class BodyForce(DeadLoad):
    """Dead force per reference volume [N/m³].

    Attributes:
        value: Three components [N/m³], or a function of time giving them.
        where: Name of a set of cells; everywhere if None.
    """

    value: Vector | Callable[[float], Vector]
    where: str | None = None


@dataclass(frozen=True)
class Gravity(DeadLoad):
    """Uniform acceleration field: force ρ0 g per reference volume.

    Attributes:
        value: Acceleration g, three components [m/s²], or a function of time giving them.
        where: Name of a set of cells; everywhere if None.
    """

    value: Vector | Callable[[float], Vector] = (0.0, 0.0, -9.81)
    where: str | None = None


@dataclass(frozen=True)
class Resultant(Windowed):
    """A force through the centre of mass and a torque on a rigid body; both keep their direction.

    Attributes:
        where: Name of the body's set of cells; None for the body of all cells.
        force: Three components [N].
        torque: Three components [N m].
        time: Factor as a function of time, such as a `Table`; 1 if None.
    """

    where: str | None = None
    force: Vector = (0.0, 0.0, 0.0)
    torque: Vector = (0.0, 0.0, 0.0)
    time: TimeFunction | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check window, vectors and time function.

        Raises:
            SceneError: If one of them cannot be used.
        """
        super().__post_init__()
        vector(self, "force", self.force)
        vector(self, "torque", self.torque)
        check_factor(self, self.time)

    @property
    def body(self) -> str:
        """Name of the body it acts on."""
        return self.where or WHOLE

    def _factor(self, t: float) -> float:
        return 0.0 if not self.active(t) else 1.0 if self.time is None else scalar(self.time(t))

    def force_at(self, t: float) -> npt.NDArray[np.float64]:
        """Force at t, shape (3,) [N]."""
        return self._factor(t) * np.asarray(self.force, dtype=np.float64)

    def torque_at(self, t: float) -> npt.NDArray[np.float64]:
        """Torque at t, shape (3,) [N m]."""
        return self._factor(t) * np.asarray(self.torque, dtype=np.float64)
