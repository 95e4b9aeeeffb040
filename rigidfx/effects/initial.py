"""How the motion starts: displacements, velocities, and static equilibrium before it.

Effects that say where they act mean the body where it lies at the start: at X plus the
displacements given here, and after a static preload.
"""

from collections.abc import Callable, Iterable, Sequence, Set
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.base.errors import SceneError, agree
from rigidfx.base.inputs import shown, vector
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array, Indices
from rigidfx.effects.base import NO_VECTOR, Effect, Vector, at_least_one, must_be, values_of
from rigidfx.effects.damping import Centrifugal, StaticForces
from rigidfx.effects.joints.joint import Axial
from rigidfx.effects.loads.dead_load import DeadLoad
from rigidfx.effects.supports import Fixed, PrescribedRotation

# Relative error of the difference quotient for a path whose velocity is not given.
CONTRADICTION = 1e-5
PARALLEL = float(np.cbrt(np.finfo(np.float64).eps))  # sine of an angle between equal axes


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
        """See whether parts that are held from the start have no velocity. Collective."""
        _refuse_shared_nodes(scene)
        # Supports that move are looked at when a run starts: their velocity may be a difference
        # quotient, over a part of Δt.
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
    """Refuse a velocity of local nodes other than a support wants its own to have. Collective."""
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
    checks: ClassVar[Checks] = {"increments": at_least_one, "spin": vector, "centre": vector}

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
