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
from rigidfx.effects.base import Effect
from rigidfx.mechanics.bodies import Bodies

__all__ = ["Spring"]

Stiffness = float | Sequence[float] | Sequence[Sequence[float]]


@dataclass(frozen=True)
class Spring(Effect):
    """Linear springs, and dashpots if asked for, between nodes and the ground.

    The force -(K (u - u₀)½ + C Δu/Δt) is spread in equal parts over the nodes. It acts during the
    whole run, in a static preload too.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        stiffness: *Total* K [N/m]: a number for all directions, three for x, y and z, or a
            symmetric 3×3 matrix without negative eigenvalue.
        damping: *Total* C [N s/m], likewise; none by default.
        relaxed: Place at which it has no force: "mesh", the reference positions of its nodes
            (u₀ = 0), so that an `InitialDisplacement` strains it as it strains cells, or "start",
            where an `InitialDisplacement` puts them (u₀ is that displacement).
    """

    is_lasting: ClassVar[bool] = True
    holds: ClassVar[bool] = True

    where: str
    stiffness: Stiffness
    damping: Stiffness = 0.0
    relaxed: Literal["start", "mesh"] = field(default="mesh", kw_only=True)

    def __post_init__(self) -> None:
        """Check both tensors.

        Raises:
            SceneError: If one is no such tensor.
        """
        super().__post_init__()
        for name in ("stiffness", "damping"):
            _tensor(self.where, name, getattr(self, name))
        if self.relaxed not in ("start", "mesh"):
            raise SceneError(
                f"{self.owner}: relaxed must be 'start' or 'mesh', got {shown(self.relaxed)}."
            )

    @property
    def K(self) -> npt.NDArray[np.float64]:
        """Total stiffness, shape (3, 3) [N/m]."""
        return _tensor(self.where, "stiffness", self.stiffness)

    @property
    def C(self) -> npt.NDArray[np.float64]:
        """Total damping, shape (3, 3) [N s/m]."""
        return _tensor(self.where, "damping", self.damping)

    @property
    def ground_stiffness(self) -> npt.NDArray[np.float64]:
        """K [N/m]."""
        return self.K

    def check(self, scene: Any) -> None:
        """Look its nodes up."""
        scene.nodes(self.where, self.kind)

    def bind(self, structure: Structure) -> Action:
        """The forces on nodes and bodies."""
        return SpringForces(self, structure)


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
        sums = np.zeros((len(bodies), 29))
        for row, body in zip(sums, bodies.of.records, strict=True):
            w, moved = weights[body.nodes], u[body.nodes]
            coordinates = np.c_[np.ones(body.nodes.size), body.offsets]
            weighted = (w[:, None] * coordinates).T
            row[:16] = (weighted @ coordinates).reshape(-1)
            row[16:28] = (weighted @ moved).reshape(-1)
            row[28] = 0.5 * np.vdot(w[:, None] * moved, moved @ self._K)
        total = np.asarray(scene.sum(sums))
        self._bodies = GroundedBodies(
            total[:, :16].reshape(-1, 4, 4),
            bodies.pose,
            total[:, 16:28].reshape(-1, 4, 3),
            float(total[:, 28].sum()),
            self._K,
            self._C,
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

    def potential(self, u: Array) -> float:
        """½ w (u - u₀)·K (u - u₀) [J]."""
        moved = u.reshape(-1, 3)[self._at] - self._rest
        return 0.5 * float(np.vdot(self._weights[:, None] * moved, moved @ self._K))

    def potential_of_bodies(self, bodies: Bodies) -> float:
        """See `Action`."""
        return self._bodies.energy(bodies)

    def dissipated(self, d: Any, dt: float) -> float:
        """Energy w Δu·C Δu/Δt [J]."""
        step = d.array_r.reshape(-1, 3)[self._at]
        return float(np.vdot(self._weights[:, None] * step, step @ self._C)) / dt


def _tensor(where: str, name: str, value: Stiffness) -> npt.NDArray[np.float64]:
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
            f"Spring on '{where}': {name} must be a number ≥ 0, three of them, or a symmetric 3×3 "
            f"matrix without negative eigenvalue, got {shown(value)}."
        )
    return tensor
