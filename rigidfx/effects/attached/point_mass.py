"""Masses without size."""

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import positive
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array
from rigidfx.effects.action import Action, Structure
from rigidfx.effects.base import Vector
from rigidfx.effects.joints.pieces import Pieces
from rigidfx.effects.joints.remote import OnFace, RemoteNodes, tie
from rigidfx.effects.joints.sides import Surface


@dataclass(frozen=True)
class PointMass(OnFace):
    """A point mass, spread in equal parts over the nodes of a set, or at a point of a face.

    It is part of inertia and momenta, also of a body that contains its nodes, and `Gravity` acts on
    it, unless a set of `Gravity` excludes its nodes. The cells at a face with a point mass in its
    middle become rigid all together or not at all. A mass beside the middle is a small body that is
    tied to the face.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part. Or a `MeanFace`
            or a `RigidFace`.
        mass: *Total* mass > 0 [kg].
        at: Place of the mass of a face, at the start [m]; the middle of the face if None.
    """

    turns: ClassVar[bool] = True
    title: ClassVar[str]  # name of its body, once a scene has placed it
    pieces: ClassVar[Pieces]  # averages and rows of the tie between the face and its body
    checks: ClassVar[Checks] = OnFace.checks | {"mass": positive}

    where: str | Surface
    mass: float
    at: Vector | None = field(default=None, kw_only=True)

    def nodal_mass(self, scene: Any) -> Array | None:
        """Mass of each local node, with ghosts [kg]; None at a point of a face. Collective."""
        if isinstance(self.where, Surface):
            return None
        return float(self.mass) * scene.shares(self.where, self.kind)

    @property
    def is_carried(self) -> bool:
        """Whether it lies beside the middle of a face: then it is a body of its own."""
        return self.face is not None and self.remote.place.face is not None

    follows = is_carried  # type: ignore[assignment]  # in a face's middle the mass there has it

    def placed(self, scene: Any) -> "PointMass":
        """The mass with its place; beside the middle of a face, with its body and the tie to it."""
        out = super().placed(scene)
        if out.face is None or not out.is_carried:
            return out
        number = 1 + next(k for k, e in enumerate(scene.named(PointMass)) if e is self)
        title = f"{self.owner} ({number})"
        return out._with(title=title, pieces=tie(title, out.remote, float(self.mass)))

    def check(self, scene: Any) -> None:
        """See whether what moves its point is flexible, or in one rigid part. Collective."""
        if self.face is None or self.is_carried:
            return
        place, n = self.remote.place, scene.owned_nodes
        total = scene.sum(place.nodes.size)
        for rigid in (effect for effect in scene.effects if effect.is_body):
            held = scene.members(rigid.where, rigid.kind)[:n, 0]
            inside = scene.sum(np.count_nonzero(held[place.nodes]))
            if 0 < inside < total:
                raise SceneError(
                    f"{self.owner}: {rigid.owner} has some of the nodes that move the mass, and "
                    "not all. Name a face that is within the part, or beside it."
                )

    def bind_points(self, structure: Structure) -> Action | None:
        """Its inertia where its nodes are in no body: the mass of a body counts by itself."""
        if self.face is None or self.is_carried or structure.static:
            return None
        place, rows = self.remote.place, structure.rows
        free = np.isin(place.nodes, rows.nodes[structure.own])
        missing = structure.scene.sum(np.count_nonzero(~free))
        return None if missing else PointInertia(self, structure)


class PointInertia(Action):
    """The derivative of the inertial force of a mass at a point; `Mass` has the force itself."""

    kind = PointMass.__name__

    def __init__(self, mass: PointMass, structure: Structure) -> None:
        self._mass, self.nodes = float(mass.mass), RemoteNodes(structure, (mass.remote.place,))

    def stiffen(self, motion: Any, tangent: Any) -> None:
        """Add the derivative of M (2 Δp/Δt - 2 v₀)/Δt."""
        self.nodes.stiffen(2 * self._mass / motion.dt**2 * np.eye(3)[None], tangent)
