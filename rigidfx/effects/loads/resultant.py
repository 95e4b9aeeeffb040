"""Force and torque on a rigid body as such."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import check_factor, scalar, vector
from rigidfx.effects.action import Action, Array, Structure
from rigidfx.effects.base import WHOLE, TimeFunction, Vector, Windowed, check_vector

__all__ = ["Resultant"]


@dataclass(frozen=True)
class Resultant(Windowed):
    """A force through the centre of mass and a torque on a rigid body; both keep their direction.

    Attributes:
        where: Name of the body's set of cells; None for the body of all cells.
        force: Three components [N].
        torque: Three components [N m].
        time: Factor as a function of time, such as a `Table`; 1 if None.
    """

    is_load: ClassVar[bool] = True
    is_dead: ClassVar[bool] = True

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
        return 0.0 if not self.acts(t) else 1.0 if self.time is None else scalar(self.time(t))

    def force_at(self, t: float) -> Array:
        """Force at t, shape (3,) [N]."""
        return self._factor(t) * np.asarray(self.force, dtype=np.float64)

    def torque_at(self, t: float) -> Array:
        """Torque at t, shape (3,) [N m]."""
        return self._factor(t) * np.asarray(self.torque, dtype=np.float64)

    def check(self, scene: Any) -> None:
        """See whether its body is there, and its function of time can be used."""
        bodies = [effect.where for effect in scene.effects if effect.is_rigid]
        if self.where not in bodies:
            pieces = scene.pieces.get(self.body, 0)
            instead = f"its {pieces} pieces are a body each" if pieces else "there are"
            raise SceneError(
                f"Resultant: '{self.where}' is not the name of a Rigid body; {instead} "
                f"{bodies or 'none'}."
            )
        for function in (self.force_at, self.torque_at):
            check_vector(scene, self.owner, self.start, partial(function, self.start))

    def signal(self, t: float, dt: float) -> Array:
        """Force and torque."""
        return np.concatenate([self.force_at(t), self.torque_at(t)])

    def bind(self, structure: Structure) -> Action | None:
        """Force and torque on the body of its name; nothing while a support clamps that."""
        names = [body.name for body in structure.bodies.of.records]
        return BodyLoad(self, names.index(self.body)) if self.body in names else None


class BodyLoad(Action):
    """A resultant on one of the bodies."""

    kind = Resultant.__name__

    def __init__(self, load: Resultant, place: int) -> None:
        """Take it over.

        Args:
            load: The effect.
            place: Which of the bodies it acts on.
        """
        self._load, self._place = load, place
        self._force: Array = np.zeros(3)
        self._torque: Array = np.zeros(3)

    def set_time(self, t: float, dt: float) -> None:
        """Evaluate force and torque.

        Raises:
            SceneError: On this rank, if one is not finite.
        """
        with np.errstate(invalid="ignore"):  # what is not finite is met below
            self._force, self._torque = self._load.force_at(t), self._load.torque_at(t)
        if not np.isfinite([self._force, self._torque]).all():
            raise SceneError(
                f"{self._load.owner}: at t = {t:g} s force and torque are {self._force} N and "
                f"{self._torque} N m; check its time function."
            )

    def load_bodies(self, moments: Array, torques: Array) -> None:
        """Add force and torque."""
        moments[self._place, 0] += self._force
        torques[self._place] += self._torque
