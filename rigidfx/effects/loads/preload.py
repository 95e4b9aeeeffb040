"""Static equilibrium before the motion starts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence, Set
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown, vector
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array
from rigidfx.effects.base import NO_VECTOR, Effect, Vector, at_least_one
from rigidfx.effects.damping import Centrifugal, StaticForces
from rigidfx.effects.joints.joint import Axial
from rigidfx.effects.loads.dead_load import DeadLoad
from rigidfx.effects.supports import PrescribedRotation

PARALLEL = float(np.cbrt(np.finfo(np.float64).eps))  # sine of an angle between equal axes


@dataclass(frozen=True)
class Preload(Effect):
    """Static equilibrium under loads of its own, from which the dynamics start.

    The loads act in the statics only. To keep a load during the run, name it in the scene, too;
    otherwise it vanishes suddenly at the start. With a spin the equilibrium is that of a rotating
    frame, under centrifugal forces at the deformed places X + u, and the motion starts
    with the velocities ω × (X + u - centre), unless the scene names an `InitialVelocity`.

    Attributes:
        loads: Dead loads, taken at the start time; may be none with a spin.
        increments: Number of equal load increments.
        spin: Angular velocity ω of the frame [rad/s].
        centre: Point of its axis [m]; if None a point of the axis of a `PrescribedRotation` that
            acts at the start, or of a hinge on the ground along the spin, or else the centre of
            mass.
    """

    in_runs: ClassVar[str | None] = "its loads in the scene"

    checks: ClassVar[Checks] = {
        "increments": at_least_one,
        "spin": vector,
        "centre": vector,
    }

    loads: Sequence[DeadLoad] = ()
    increments: int = 1
    spin: Vector = field(default=NO_VECTOR, kw_only=True)
    centre: Vector | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Refuse loads that are none; there may be none with a spin."""
        super().__post_init__()
        given = (self.loads,) if isinstance(self.loads, DeadLoad) else self.loads
        listed = isinstance(given, Iterable) and not isinstance(given, Set)
        loads = tuple(given) if listed else ()
        empty = listed and not loads and self.turns
        if not (loads or empty) or not all(isinstance(load, DeadLoad) for load in loads):
            raise SceneError(
                f"Preload: loads must be one or more dead loads, got {shown(given)}. Without "
                "loads it needs a spin."
            )
        object.__setattr__(self, "loads", loads)

    def check(self, scene: Any) -> None:
        """Check its loads."""
        for load in self.loads:
            load.check(scene)

    @property
    def turns(self) -> bool:
        """Whether its frame turns."""
        return any(self.spin)

    def centrifugal(self, scene: Any, share: Callable[[], float]) -> list[Effect]:
        """Its centrifugal forces, times a share; none without a spin. Collective."""
        if not self.turns:
            return []
        axis = np.asarray(self.spin), np.asarray(self._pivot(scene))
        return [StaticForces(lambda structure: Centrifugal(*axis, structure, share))]

    def velocities(self, scene: Any, x: Array) -> Array:
        """ω × (x - centre) of some places, shape (nodes, 3) [m/s]. Collective."""
        return np.cross(self.spin, x - np.asarray(self._pivot(scene)))

    def _pivot(self, scene: Any) -> Vector:
        """A point of the axis [m]. Collective."""
        if self.centre is not None:
            return self.centre
        turned = [s for s in scene.named(PrescribedRotation) if s.acts(0.0)]
        if turned:
            return turned[0].through
        hinges = self._hinges(scene) if self.turns else []
        x, y, z = hinges[0] if hinges else scene.centre_of_mass
        return float(x), float(y), float(z)

    def _hinges(self, scene: Any) -> list[Array]:
        """Places of joints on the ground that leave a turn along the spin; they lie on one axis."""
        spin, found = np.asarray(self.spin) / np.linalg.norm(self.spin), list[Array]()
        for joint in scene.named(Axial):
            if joint.holds and "angle" in joint.pieces.coordinates:
                across = np.linalg.norm(np.cross(spin, joint.direction))
                if across < PARALLEL:
                    found.append(np.asarray(joint.at, dtype=np.float64))
        apart = [float(np.linalg.norm(np.cross(spin, at - found[0]))) for at in found]
        if max(apart, default=0.0) > PARALLEL * scene.mean_cell_size:
            raise SceneError(
                "Preload: hinges on the ground along the spin have different axes. Give the centre "
                "of the spin."
            )
        return found
