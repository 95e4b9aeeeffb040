"""Springs and dashpots between nodes and the ground."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import numbers, shown
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array
from rigidfx.effects.action import Action, Structure
from rigidfx.effects.base import Vector, one_of
from rigidfx.effects.joints.remote import OnFace, RemoteNodes
from rigidfx.effects.joints.sides import Surface
from rigidfx.effects.nodes import LinearNodes

Stiffness = float | Sequence[float] | Sequence[Sequence[float]]


def _tensor(owner: str, name: str, value: Stiffness) -> Array:
    """A symmetric positive semidefinite tensor from one, three or nine numbers, shape (3, 3)."""
    given = numbers(value)
    tensor = np.diag(np.broadcast_to(given, 3)) if given.shape in ((), (3,)) else given
    good = tensor.shape == (3, 3) and bool(np.isfinite(tensor).all())
    rounding = 1e-12 * np.abs(tensor).max(initial=0.0)
    good = good and np.allclose(tensor, tensor.T, atol=rounding)
    if not good or np.linalg.eigvalsh(tensor)[0] < -rounding:
        raise SceneError(
            f"{owner}: {name} must be a number ≥ 0, three of them, or a symmetric 3×3 "
            f"matrix without negative eigenvalue, got {shown(value)}."
        )
    return tensor


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
    checks: ClassVar[Checks] = OnFace.checks | {
        "stiffness": _tensor,
        "damping": _tensor,
        "relaxed": one_of("start", "mesh"),
    }

    where: str | Surface
    stiffness: Stiffness
    damping: Stiffness = 0.0
    relaxed: Literal["start", "mesh"] = field(default="mesh", kw_only=True)
    at: Vector | None = field(default=None, kw_only=True)

    @property
    def K(self) -> Array:
        """Total stiffness, shape (3, 3) [N/m]."""
        return _tensor(self.owner, "stiffness", self.stiffness)

    @property
    def C(self) -> Array:
        """Total damping, shape (3, 3) [N s/m]."""
        return _tensor(self.owner, "damping", self.damping)

    ground_stiffness = K  # type: ignore[assignment]

    def check(self, scene: Any) -> None:
        """Look its nodes up."""
        if self.face is None:
            scene.nodes(self.where, self.kind)

    def bind(self, structure: Structure) -> Action | None:
        """The forces on nodes and bodies; None of a spring of a face."""
        if self.face is not None:
            return None
        scene = structure.scene
        weights = scene.shares(self.where, self.kind)[: scene.owned_nodes]
        on = np.flatnonzero(weights)
        X = scene.space.tabulate_dof_coordinates()[on]
        rest = scene.start_places[on] - X if self.relaxed == "start" else np.zeros_like(X)
        return SpringForces(self, structure, LinearNodes(structure, on, weights[on], rest))

    def bind_points(self, structure: Structure) -> Action | None:
        """Its force at a point of a face."""
        if self.face is None:
            return None
        place, mesh = self.remote.place, self.relaxed == "mesh"
        rest = self.remote.on_mesh(structure.scene) if mesh else place.start
        return SpringForces(self, structure, RemoteNodes(structure, (place,), rest))


class SpringForces(Action):
    """A spring on the nodes and bodies of a division, or at a point of a face."""

    kind = Spring.__name__

    def __init__(
        self, spring: Spring, structure: Structure, nodes: LinearNodes | RemoteNodes
    ) -> None:
        """Store the nodes, K and C. Collective."""
        self.nodes, self._K = nodes, spring.K
        self._C = np.zeros((3, 3)) if structure.static else spring.C
        self.rounding = float(np.linalg.norm(self._K)) * nodes.far()

    def resist(self, motion: Any, forces: Any) -> None:
        """Add w (K u½ + C Δu/Δt)."""
        nodes = self.nodes
        by_moved = nodes.share * self._K + self._C / motion.dt
        force = nodes.start(motion) @ self._K + nodes.moved(motion) @ by_moved
        nodes.add(nodes.weights[:, None] * force, forces)

    def stiffen(self, motion: Any, tangent: Any) -> None:
        """Add w (½ K + C/Δt)."""
        block = self.nodes.share * self._K + self._C / motion.dt
        self.nodes.stiffen(self.nodes.weights[:, None, None] * block, tangent)

    def stored(self, at: Any) -> float:
        """½ w (u - u₀)·K (u - u₀) [J]."""
        return 0.5 * self._product(self.nodes.displacement(at), self._K)

    def taken(self, motion: Any) -> float:
        """Energy w Δu·C Δu/Δt [J]."""
        return self._product(self.nodes.moved(motion), self._C) / float(motion.dt)

    def _product(self, u: Array, tensor: Array) -> float:
        return float(np.vdot(self.nodes.weights[:, None] * u, u @ tensor))
