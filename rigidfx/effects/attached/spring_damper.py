"""Springs, dampers and cables between two points: docs/theory/joints.md#springs-between-two-points.

The force N is by the law of `Elastic` along the distance L, with exactly the energy of the law. In
statics its direction is r₁/L₁, r₁ from the first end to the second one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import at_least_zero, truth, vector
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array
from rigidfx.effects.action import Action, Structure
from rigidfx.effects.base import Vector as Point
from rigidfx.effects.joints.elements import Elastic
from rigidfx.effects.joints.joint import Between
from rigidfx.effects.joints.remote import RemoteMotion, RemoteNodes
from rigidfx.effects.joints.sides import GROUND, end_of, one_side
from rigidfx.effects.joints.vectors import value_at

TAUT = float(np.sqrt(np.finfo(np.float64).eps))  # of its length, by which a taut cable may be short


@dataclass(frozen=True)
class SpringDamperReport:
    """Force and length of a spring between two points in a step.

    Attributes:
        force: Tension, the mean over the step; below zero where it pushes its ends apart [N].
        length: Distance of its ends at the end of the step [m].
        rate: Mean rate of the length in the step [m/s]; 0 in statics.
    """

    force: float
    length: float
    rate: float


@dataclass(frozen=True)
class SpringDamper(Between, Elastic):
    """A spring, a damper or a cable between two points, in the whole run.

    An end is a point of the ground, of a `Rigid` part or of a face, or the mean place of the nodes
    of a set, such as a single vertex.

    Attributes:
        a: First end: "ground", the name of a `Rigid` part or of a set of any dimension, a
            `MeanFace` or a `RigidFace`.
        b: Second end, likewise.
        stiffness: k [N/m].
        damping: c [N s/m].
        length: Length without force [m]; the distance of the ends on the mesh if None.
        pulls_only: Whether it is a cable: without force while it is shorter than `length`, its
            damper too, which never pushes.
        at_a: Place of the first end at the start [m]: needed of the ground; the centre of a part or
            a face if None; not of a set.
        at_b: Place of the second end, likewise.
        name: Its name in reports; kind and ends if None.
    """

    _free: ClassVar[float]  # length without force, once a scene has placed it [m]
    _first: ClassVar[float]  # length at the start, likewise
    is_lasting: ClassVar[bool] = True
    many: ClassVar[str] = "springs"
    checks: ClassVar[Checks] = {
        **(Between.checks | Elastic.checks),
        **dict.fromkeys("ab", one_side("the name of a Rigid part or of a set")),
        "length": at_least_zero,
        "pulls_only": truth,
        "at_a": vector,
        "at_b": vector,
    }

    stiffness: float = 0.0
    damping: float = field(default=0.0, kw_only=True)
    length: float | None = field(default=None, kw_only=True)
    pulls_only: bool = field(default=False, kw_only=True)
    at_a: Point | None = field(default=None, kw_only=True)
    at_b: Point | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Raise `SceneError` if an end or a value cannot be used."""
        super().__post_init__()
        if not (self.stiffness or self.damping):
            raise SceneError(f"{self.owner}: give a stiffness, a damping or both.")
        for name, side in (("at_a", self.a), ("at_b", self.b)):
            if getattr(self, name) is None and side == GROUND:
                raise SceneError(f"{self.owner}: give {name}, the place of its end on the ground.")

    @property
    def ends_at(self) -> tuple[float, float]:
        """Length without force, likewise; a cable is free below it [m]."""
        return -inf if self.pulls_only else self._free, self._free

    @property
    def loose(self) -> float:  # type: ignore[override]
        """A cable that is but just slack counts as taut [m]."""
        return max(TAUT * self.ends_at[1], float(np.finfo(np.float64).tiny))

    @property
    def taut(self) -> bool:
        """Whether it resists at the start what moves its ends apart, likewise."""
        return self.stiffness > 0 and self.is_stiff(self._first)

    def placed(self, scene: Any) -> SpringDamper:
        """The spring with its ends on a mesh; raise `SceneError` if it cannot be. Collective."""
        self.check_title(scene)
        X = scene.space.tabulate_dof_coordinates()
        given = (self.a, self.at_a), (self.b, self.at_b)
        ends = [end_of(scene, self.owner, *end) for end in given]
        at_start = [end.start for end in ends]
        on_mesh = [value_at(scene, end, X) for end in ends]
        first, distance = (float(np.linalg.norm(b - a)) for a, b in (at_start, on_mesh))
        if min(first, distance) <= TAUT * np.abs(on_mesh).max() and self.length != 0:
            raise SceneError(
                f"{self.owner}: both ends are at {at_start[0]} m, which leaves it no direction. "
                "Place them apart, or give length=0."
            )
        free = distance if self.length is None else float(self.length)
        return self._with(averages=tuple(ends), _free=free, _first=first)

    def bind_points(self, structure: Structure) -> Action:
        """Its forces on its ends."""
        return Tension(self, structure)


class Tension(Action):
    """The forces of a spring on its two ends."""

    kind = SpringDamper.__name__

    def __init__(self, spring: SpringDamper, structure: Structure) -> None:
        self._spring, self._static = spring, structure.static
        self.title, self.nodes = spring.title, RemoteNodes(structure, spring.averages)
        self.rounding = float(spring.stiffness * spring.ends_at[1])

    def _step(self, motion: RemoteMotion) -> tuple[float, float, Array, Array]:
        """Lengths at both ends of a step [m], n̄, and the unit vector at its end."""
        places, moved = self.nodes.positions(motion), self.nodes.moved(motion)
        before, gained = places[1] - places[0], moved[1] - moved[0]
        after = before + gained
        q0, q1 = float(np.linalg.norm(before)), float(np.linalg.norm(after))
        n1 = after / (q1 or 1.0)
        return q0, q1, n1 if self._static else (before + after) / ((q0 + q1) or 1.0), n1

    def _tension(self, q0: float, q1: float, dt: float) -> tuple[float, float]:
        """N [N], and its derivative by the length at the end [N/m]."""
        spring = self._spring
        force, slope, *_ = spring.pull(q1) if self._static else spring.law(q0, q1, dt)
        return -force, -slope

    def resist(self, motion: Any, forces: Any) -> None:
        """Add N n̄ to the ends."""
        q0, q1, n, _ = self._step(motion)
        force = self._tension(q0, q1, motion.dt)[0] * n
        self.nodes.add(np.stack([-force, force]), forces)

    def stiffen(self, motion: Any, tangent: Any) -> None:
        """Add n̄ ⊗ N' n₁ + N (1 - n̄ ⊗ n₁)/(L₀ + L₁)."""
        q0, q1, n, n1 = self._step(motion)
        force, slope = self._tension(q0, q1, motion.dt)
        size = q1 if self._static else q0 + q1
        K = slope * np.eye(3)
        if size > 0:
            across = np.eye(3) - np.outer(n, n1)
            K = slope * np.outer(n, n1) + force / size * across
        self.nodes.couple(np.array([[K, -K], [-K, K]]).swapaxes(1, 2), tangent)

    def taken(self, motion: Any) -> float:
        """Energy that the damper takes in a step [J]."""
        if self._static:
            return 0.0
        q0, q1, *_ = self._step(motion)
        return self._spring.law(q0, q1, motion.dt)[2]

    def stored(self, at: Any) -> float:
        """Energy of the law at its length [J]."""
        a, b = self.nodes.positions(at)
        return self._spring.stored(float(np.linalg.norm(b - a)))

    def told(self, motion: Any) -> SpringDamperReport:
        """Tension, length and rate of a step."""
        q0, q1, *_ = self._step(motion)
        rate = 0.0 if self._static else (q1 - q0) / motion.dt
        return SpringDamperReport(self._tension(q0, q1, motion.dt)[0], q1, rate)
