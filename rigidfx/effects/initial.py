"""How the motion starts: displacements and velocities.

Effects that say where they act mean the body where it lies at the start: at X plus the
displacements given here, and after a static preload.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.base.errors import SceneError, agree
from rigidfx.base.inputs import vector
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array, Indices
from rigidfx.effects.base import NO_VECTOR, Effect, Vector, must_be, values_of
from rigidfx.effects.supports import Fixed

# Relative error of the difference quotient for a path whose velocity is not given.
CONTRADICTION = 1e-5


@dataclass(frozen=True)
class InitialDisplacement(Effect):
    """Displacement at the start, by a function of the reference position; it strains the body.

    Supports start from the displaced positions.

    Attributes:
        function: x of shape (3, n) [m] → displacements of shape (3, n) [m].
        where: Name of a set whose nodes it displaces, of any dimension; all nodes if None.
    """

    checks: ClassVar[Checks] = {"function": must_be("a function of x", callable)}

    function: Callable[[Array], npt.ArrayLike]
    where: str | None = field(default=None, kw_only=True)

    def values(self, scene: Any) -> Array:
        """Its displacements per local node with ghosts, shape (nodes, 3) [m]. Collective."""
        members = scene.members(self.where, self.kind)
        return values_of(self.kind, self.function, scene) * members


def places_at_start(scene: Any) -> Array:
    """Places of the local nodes where displacements put them, shape (nodes, 3) [m]. Collective."""
    given = [effect.values(scene) for effect in scene.named(InitialDisplacement)]
    return np.asarray(sum(given, scene.space.tabulate_dof_coordinates()))


@dataclass(frozen=True)
class InitialVelocity(Effect):
    """Velocity at the start: a rigid motion, or any function of the reference position.

    The rigid motion is v = linear + ω × (x - centre), with positions x after an
    `InitialDisplacement` or a `Preload`.

    Attributes:
        linear: Velocity of the centre [m/s].
        angular: Angular velocity ω [rad/s].
        centre: Point of the rotation [m]; if None the centre of mass of `where`, as it lies.
        function: Reference positions X of shape (3, n) [m] → velocities of shape (3, n) [m/s],
            added to the rigid motion.
        where: Name of a set whose nodes it moves, of any dimension; all nodes if None.
    """

    in_runs: ClassVar[str | None] = "simulate"

    checks: ClassVar[Checks] = {
        "linear": vector,
        "angular": vector,
        "centre": vector,
        "function": must_be("a function of x", callable),
    }

    linear: Vector = NO_VECTOR
    angular: Vector = NO_VECTOR
    centre: Vector | None = None
    function: Callable[[Array], npt.ArrayLike] | None = None
    where: str | None = field(default=None, kw_only=True)

    def check(self, scene: Any) -> None:
        """See whether parts that are held from the start have no velocity. Collective.

        Supports that move are looked at when a run starts: their velocity may be a difference
        quotient, over a part of Δt.
        """
        _refuse_shared_nodes(scene)
        velocity = given_velocity(scene, scene.start_places)
        for support, nodes in scene.supports:
            if isinstance(support, Fixed) and support.acts(0.0):
                agree_with_support(scene, velocity, support, nodes, np.zeros(3))


def given_velocity(scene: Any, x: Array) -> Array:
    """Sum of all initial velocities at places x of local nodes, (nodes, 3) [m/s]. Collective."""
    v = np.zeros_like(x)
    for effect in scene.named(InitialVelocity):
        members = scene.members(effect.where, effect.kind)
        centre = effect.centre
        if centre is None:
            centre = scene.centre_of(members, x)
        own = np.asarray(effect.linear) + np.cross(effect.angular, x - np.asarray(centre))
        if effect.function is not None:
            own = own + values_of(effect.kind, effect.function, scene)
        v += own * members
    return v


def _refuse_shared_nodes(scene: Any) -> None:
    """Refuse velocities of two sets with common nodes, which would get the sum. Collective."""
    named = [effect for effect in scene.named(InitialVelocity) if effect.where is not None]
    for a, b in combinations(named, 2):
        both = scene.members(a.where, a.kind) * scene.members(b.where, b.kind)
        if a.where != b.where and scene.sum(both[: scene.owned_nodes].sum()) > 0:
            raise SceneError(
                f"InitialVelocity: '{a.where}' and '{b.where}' have nodes in common, which would "
                "get the sum of both velocities. Name sets without common nodes."
            )


def agree_with_support(
    scene: Any, velocity: Array, support: Any, nodes: Indices, wanted: Array
) -> None:
    """Refuse a velocity of local nodes that contradicts a support at the start. Collective.

    The support wants its nodes to have a velocity of shape (3,) or (its nodes, 3) [m/s].
    """
    scale = scene.comm.allreduce(float(np.abs(velocity).max(initial=0.0)), op=MPI.MAX)
    error = np.abs((velocity[nodes] - wanted)[:, list(support.axes)]).max(initial=0.0)
    bound = max(scale, float(np.abs(wanted).max(initial=0.0)))
    agree(
        scene.comm,
        None
        if error <= CONTRADICTION * bound
        else f"InitialVelocity contradicts {support.owner} "
        f"(components '{support.components}'): they differ by {error:.3g} m/s at its nodes. "
        "Give the nodes of a support its velocity, or start the support later.",
    )
