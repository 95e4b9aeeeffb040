"""Force and torque on a rigid body as such, or at a point of a face."""

from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError, together
from rigidfx.base.inputs import vector
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array
from rigidfx.effects.action import Action, Structure
from rigidfx.effects.base import NO_VECTOR, WHOLE, Scaled, Vector, mean_over
from rigidfx.effects.joints.remote import OnFace, RemoteMotion, RemoteNodes
from rigidfx.effects.joints.sides import Surface
from rigidfx.effects.loads.dead_load import DeadForces
from rigidfx.effects.nodes import Forces
from rigidfx.mechanics.rotation import skew


@dataclass(frozen=True)
class Resultant(OnFace, Scaled):
    """A force and a torque on a rigid body or at a point of a face; both keep their direction.

    The force on a body acts at its centre of mass. A force beside the middle of a face acts in its
    middle, with the couple of its arm, which turns with the face.

    Attributes:
        where: Name of the body's set of cells; None for the body of all cells; a `MeanFace` or a
            `RigidFace`.
        at: Place of the force on a face, at the start [m]; the middle of the face if None.
        force: Three components [N].
        torque: Three components [N m].
    """

    turns: ClassVar[bool] = True
    checks: ClassVar[Checks] = Scaled.checks | OnFace.checks | {"force": vector, "torque": vector}

    where: str | Surface | None = None
    force: Vector = NO_VECTOR
    torque: Vector = NO_VECTOR
    at: Vector | None = field(default=None, kw_only=True)

    @property
    def is_dead(self) -> bool:  # type: ignore[override]
        """Whether the motion does not change it."""
        return self.face is None or not (any(self.torque) or self._is_off_centre)

    @property
    def _is_off_centre(self) -> bool:
        """Whether it acts at a point beside the middle of a face."""
        return self.at is not None and any(self.force) and bool(self.remote.arm.any())

    @property
    def body(self) -> str | None:
        """Name of the body it acts on; None if it acts on a face."""
        return None if isinstance(self.where, Surface) else self.where or WHOLE

    def _both(self, t: float) -> Array:
        """Force [N] and torque [N m] at t, shape (2, 3)."""
        with np.errstate(invalid="ignore"):  # what is not finite is met below
            return self.factor(t) * np.array([self.force, self.torque], dtype=np.float64)

    def signal(self, t: float, dt: float) -> Array:
        """Force and torque."""
        return self._both(t).ravel()

    def both_at(self, t: float) -> Array:
        """The same; `SceneError` on this rank, if one is not finite."""
        force, torque = both = self._both(t)
        if not np.isfinite(both).all():
            raise SceneError(
                f"{self.owner}: at t = {t:g} s force and torque are {force} N and {torque} N m; "
                "check its time function."
            )
        return both

    def intensity(self, t: float) -> Array:
        """Force at t that dead loads have in the middle of a face: see `both_at`."""
        return self.both_at(t)[0]

    def weights(self, scene: Any) -> Array:
        """Weight of each owned node in the middle of its face [1]."""
        out, middle = np.zeros(scene.owned_nodes), self.remote.middle
        out[middle.nodes] = middle.weights
        return out

    def bind_points(self, structure: Structure) -> Action | None:
        """Its couple on a face, as far as the motion changes it."""
        return None if self.is_dead else FaceCouple(self, structure)

    def check(self, scene: Any) -> None:
        """See whether its body is there, and its function of time can be used."""
        bodies = [effect.where for effect in scene.effects if effect.is_rigid]
        if self.face is None and self.where not in bodies:
            pieces = scene.pieces.get(self.body, 0)
            instead = f"its {pieces} pieces are a body each" if pieces else "there are"
            deforms = any(e.deforms and e.where == self.where for e in scene.effects if e.is_body)
            at = " A Reduced part takes a Traction, or a Resultant at a MeanFace of it."
            raise SceneError(
                f"Resultant: '{self.where}' is not the name of a Rigid body; {instead} "
                f"{bodies or 'none'}.{at * deforms}"
            )
        function = f"{self.owner}: its function of time"
        together(scene.comm, function, partial(self.both_at, self.start))

    def bind(self, structure: Structure) -> Action | None:
        """Force and torque on the body of its name; nothing while a support clamps that."""
        if self.body is None:
            return DeadForces(self, structure) if any(self.force) else None
        names = [body.name for body in structure.bodies.of.records]
        if self.body not in names:
            return None
        return BodyLoad(self, structure, names.index(self.body))


class ForceAndTorque(Action):
    """A force and a torque as functions of time."""

    kind = Resultant.__name__

    def __init__(self, load: Resultant, structure: Structure) -> None:
        self._load, self._over = load, structure.over
        self._both: Array = np.zeros((2, 3))

    def set_time(self, t: float, dt: float) -> None:
        """Evaluate force and torque; `SceneError` on this rank, if one is not finite."""
        self._both = mean_over(self._load.both_at, t, self._over(dt))


class BodyLoad(ForceAndTorque):
    """A resultant on one of the bodies."""

    def __init__(self, load: Resultant, structure: Structure, place: int) -> None:
        super().__init__(load, structure)
        self._place, self._once = place, structure.once

    def load(self, forces: Forces) -> None:
        """Add force and torque."""
        force, torque = self._once * self._both
        forces.moments[self._place, 0] += force
        forces.torques[self._place] += torque


class FaceCouple(ForceAndTorque):
    """The couple of a resultant on three directions d_k of a face.

    A torque M acts by ½ M × d^k, d^k their dual basis; a force F at the arm Σ b_k d_k by b_k F.
    """

    dissipates = False

    def __init__(self, load: Resultant, structure: Structure) -> None:
        super().__init__(load, structure)
        self.nodes = RemoteNodes(structure, load.remote.directions)
        self._arm = load.remote.arm[:, None]

    def _duals(self, motion: RemoteMotion) -> Array:
        """The dual basis d^k, a row each."""
        nodes = self.nodes
        acting = nodes.positions(motion) + nodes.share * nodes.moved(motion)
        return np.asarray(np.linalg.inv(acting.T))

    def _resistance(self, motion: RemoteMotion) -> Array:
        """Forces on the directions, shape (3, 3) [N]."""
        force, torque = self._both
        return np.asarray(-0.5 * np.cross(torque, self._duals(motion)) - self._arm * force)

    def resist(self, motion: Any, forces: Any) -> None:
        """Add the forces on the directions."""
        self.nodes.add(self._resistance(motion), forces)

    def stiffen(self, motion: Any, tangent: Any) -> None:
        """Add their derivative by δd^k = -Σ_a (d^k · δd_a) d^a."""
        E = self._duals(motion)
        turned = -0.5 * E @ skew(self._both[1]).T
        self.nodes.couple(-self.nodes.share * np.einsum("ai,kb->kiab", turned, E), tangent)

    def taken(self, motion: Any) -> float:
        """Work against the couple in a step [J]."""
        return float(np.vdot(self._resistance(motion), self.nodes.moved(motion)))
