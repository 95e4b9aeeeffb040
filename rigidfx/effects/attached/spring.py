"""Springs and dashpots between nodes and the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import numbers, shown
from rigidfx.effects.action import Action, Array, Structure
from rigidfx.effects.attached.grounded import Grounded, GroundedBodies
from rigidfx.effects.base import Vector
from rigidfx.effects.joints.face_motion import value_at
from rigidfx.effects.joints.on_face import OnFace, PointLaw
from rigidfx.effects.joints.sides import Surface
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments

__all__ = ["Spring"]

Stiffness = float | Sequence[float] | Sequence[Sequence[float]]


@dataclass(frozen=True)
class Spring(OnFace):
    """Linear springs, and dashpots if asked for, between nodes and the ground.

    The force -(K (u - u₀)½ + C Δu/Δt) is spread in equal parts over the nodes. It acts during the
    whole run, in a static preload too.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part. Or a `MeanFace`
            or a `RigidFace`: one spring at a point of it.
        stiffness: *Total* K [N/m]: a number for all directions, three for x, y and z, or a
            symmetric 3×3 matrix without negative eigenvalue.
        damping: *Total* C [N s/m], likewise; none by default.
        relaxed: Positions without force: "mesh", the reference positions of its nodes
            (u₀ = 0), or "start", the positions after an `InitialDisplacement` (u₀ is that
            displacement).
        at: Place of the spring of a face, at the start [m]; the middle of the face if None.
    """

    is_lasting: ClassVar[bool] = True
    holds: ClassVar[bool] = True

    where: str | Surface
    stiffness: Stiffness
    damping: Stiffness = 0.0
    relaxed: Literal["start", "mesh"] = field(default="mesh", kw_only=True)
    at: Vector | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check both tensors.

        Raises:
            SceneError: If one is no such tensor.
        """
        super().__post_init__()
        for name in ("stiffness", "damping"):
            _tensor(self.owner, name, getattr(self, name))
        self.check_at()
        if self.relaxed not in ("start", "mesh"):
            raise SceneError(
                f"{self.owner}: relaxed must be 'start' or 'mesh', got {shown(self.relaxed)}."
            )

    @property
    def K(self) -> npt.NDArray[np.float64]:
        """Total stiffness, shape (3, 3) [N/m]."""
        return _tensor(self.owner, "stiffness", self.stiffness)

    @property
    def C(self) -> npt.NDArray[np.float64]:
        """Total damping, shape (3, 3) [N s/m]."""
        return _tensor(self.owner, "damping", self.damping)

    @property
    def ground_stiffness(self) -> npt.NDArray[np.float64]:
        """K [N/m]."""
        return self.K

    def check(self, scene: Any) -> None:
        """Look its nodes up."""
        if self.face is None:
            scene.nodes(self.where, self.kind)

    def bind(self, structure: Structure) -> Action | None:
        """The forces on nodes and bodies; None of a spring of a face, which has a law."""
        return SpringForces(self, structure) if self.face is None else None

    def law(self, structure: Structure) -> PointLaw | None:
        """Its force at a point of a face."""
        return PointSpring(self, structure.scene, structure.static) if self.face else None


class SpringForces(Grounded):
    """A spring on the nodes and bodies of a division."""

    kind = Spring.__name__

    def __init__(self, spring: Spring, structure: Structure) -> None:
        """Find its nodes. Collective.

        Args:
            spring: The effect.
            structure: Its nodes and bodies; displacements are up to date at all nodes of bodies.
        """
        scene, rows, bodies = structure.scene, structure.rows, structure.bodies
        n = scene.owned_nodes
        weights = scene.shares(spring.where, self.kind)[:n]
        self._at = np.flatnonzero(structure.own & (weights[rows.nodes] > 0))
        self._nodes = rows.nodes[self._at]
        self._weights = weights[self._nodes]
        self._dofs = rows.dofs.reshape(-1, 3)[self._at]
        self._u0 = structure.u
        self._share = 1.0 if structure.static else 0.5
        self._K = spring.K
        self._C = np.zeros((3, 3)) if structure.static else spring.C
        X = scene.space.tabulate_dof_coordinates()[:n]
        rest = scene.start_places[:n] - X if spring.relaxed == "start" else np.zeros_like(X)
        self._rest = rest[self._nodes]
        u = self._u0[: 3 * n].reshape(-1, 3) - rest
        sums, energy = np.zeros((len(bodies), 4, 7)), 0.0
        for out, body in zip(sums, bodies.of.records, strict=True):
            w, moved = weights[body.nodes, None], u[body.nodes]
            coordinates = np.c_[np.ones(body.nodes.size), body.offsets]
            out[:] = (w * coordinates).T @ np.c_[coordinates, moved]
            energy += 0.5 * float(np.vdot(w * moved, moved @ self._K))
        total = np.asarray(scene.sum(sums))
        self._bodies = GroundedBodies(
            total[:, :, :4],
            bodies.pose,
            total[:, :, 4:],
            float(scene.sum(energy)),
            self._K,
            self._C,
            scene.comm.rank == 0,
            self._share,
        )
        x = np.abs(X + rest + u).max(initial=0.0)
        self.rounding = float(np.linalg.norm(self._K)) * scene.comm.allreduce(float(x))

    def resist_nodes(self, d: Any, dt: float, f: Any) -> None:
        """Add w (K u½ + C Δu/Δt)."""
        step = d.array_r.reshape(-1, 3)[self._at]
        strained = self._u0[self._dofs] - self._rest + self._share * step
        force = strained @ self._K + step @ self._C / dt
        f.array.reshape(-1, 3)[self._at] += self._weights[:, None] * force

    def stiffen_nodes(self, tangent: Any, dt: float, prolongation: Any) -> None:
        """Add w (½ K + C/Δt)."""
        block = self._share * self._K + self._C / dt
        tangent.add_nodal(self._nodes, self._weights[:, None, None] * block)

    def stored(self, u: Array, bodies: Bodies, t: float) -> float:
        """½ w (u - u₀)·K (u - u₀) [J]."""
        moved = u.reshape(-1, 3)[self._at] - self._rest
        own = 0.5 * float(np.vdot(self._weights[:, None] * moved, moved @ self._K))
        return own + self._bodies.energy(bodies)

    def dissipated(self, d: Any, dt: float, increments: Increments) -> float:
        """Energy w Δu·C Δu/Δt [J]."""
        step = d.array_r.reshape(-1, 3)[self._at]
        own = float(np.vdot(self._weights[:, None] * step, step @ self._C)) / dt
        return own + self._bodies.dissipated(increments)


class PointSpring(PointLaw):
    """A spring, and a dashpot, at a point of a face."""

    kind = Spring.__name__

    def __init__(self, spring: Spring, scene: Any, static: bool) -> None:
        """Find where it has no force. Collective.

        Args:
            spring: The effect.
            scene: The problem.
            static: Whether forces are those at the end of a step.
        """
        place = spring.remote.place
        self.averages = (place,)
        self._share, self._K = (1.0 if static else 0.5), spring.K
        self._C, self._dt = np.zeros((3, 3)) if static else spring.C, 1.0
        self._rest = place.start
        if spring.relaxed == "mesh":
            self._rest = value_at(scene, place, scene.space.tabulate_dof_coordinates())

    def set_time(self, t: float, dt: float) -> None:
        """See `PointLaw`."""
        self._dt = dt or 1.0  # of no meaning where statics have a fixed time

    def resistance(self, start: Array, moved: Array) -> Array:
        """See `PointLaw`: K (p - p₀)½ + C Δp/Δt."""
        strained = start - self._rest + self._share * moved
        return np.asarray(strained @ self._K + moved @ self._C / self._dt)

    def stiffness(self, start: Array, moved: Array) -> Array:
        """See `PointLaw`."""
        return (self._share * self._K + self._C / self._dt)[None, :, None, :]

    def taken(self, start: Array, moved: Array) -> float:
        """See `PointLaw`."""
        return float(np.vdot(moved, moved @ self._C)) / self._dt

    def stored(self, p: Array) -> float:
        """See `PointLaw`."""
        strained = p - self._rest
        return 0.5 * float(np.vdot(strained, strained @ self._K))


def _tensor(owner: str, name: str, value: Stiffness) -> npt.NDArray[np.float64]:
    """A symmetric positive semidefinite tensor from one, three or nine numbers, shape (3, 3)."""
    given = numbers(value)
    if given.shape == (3, 3):
        tensor = given
    elif given.shape in ((), (3,)):
        tensor = np.diag(np.broadcast_to(given, 3))
    else:
        tensor = np.full((3, 3), np.nan)
    size = np.abs(tensor).max()
    if not np.isfinite(tensor).all() or not np.allclose(tensor, tensor.T, atol=1e-12 * size):
        good = False
    else:
        good = bool(np.linalg.eigvalsh(tensor)[0] >= -1e-12 * size)
    if not good:
        raise SceneError(
            f"{owner}: {name} must be a number ≥ 0, three of them, or a symmetric 3×3 "
            f"matrix without negative eigenvalue, got {shown(value)}."
        )
    return tensor
