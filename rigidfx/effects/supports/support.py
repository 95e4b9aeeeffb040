"""The base of all supports, with the components that they hold; supports at rest; their forces."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError, together
from rigidfx.base.inputs import shown
from rigidfx.base.types import Array
from rigidfx.effects.base import Effect, Windowed, check_values, check_vector, some_points

FLAT = 1e-9  # of the size of the mesh: extent of a plane along its normal


@dataclass(frozen=True)
class Support(Windowed):
    """Prescribes components of the motion of a named set's nodes.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        components: Which of the components x, y, z are held, for example "xz".
    """

    is_load: ClassVar[bool] = True
    is_support: ClassVar[bool] = True
    holds: ClassVar[bool] = True
    moves: ClassVar[bool] = False  # whether its motion is a user's function of time
    uniform: ClassVar[bool] = True  # whether all its nodes move alike

    where: str
    components: str = "xyz"

    def __post_init__(self) -> None:
        """Raise `SceneError` unless components names some of x, y, z once each."""
        super().__post_init__()
        c = self.components
        if not isinstance(c, str) or not c or set(c) - set("xyz") or len(set(c)) != len(c):
            raise SceneError(
                f"{type(self).__name__} on '{self.where}': components must be some of 'xyz', "
                f"each once, got {shown(c)}."
            )

    @property
    def bends(self) -> Mapping[float, float]:
        """None: a kink of a path is a jump of the velocity."""
        return {}

    @property
    def axes(self) -> tuple[int, ...]:
        """The held components as numbers 0, 1, 2."""
        return tuple("xyz".index(c) for c in self.components)

    def displacements_at(self, t: float, X: Array) -> Array:
        """Prescribed displacements of points X at t [s], up to a constant of no consequence.

        Shape (3,), or (points, 3) where they are not `uniform` [m]; zero of one at rest.
        """
        return np.zeros(3)

    def increments_of(self, t0: float, t1: float, X: Array, x: Array) -> Array:
        """Prescribed increments from t0 to t1 of points X, at x at t0, shape (points, 3) [m]."""
        return self.displacements_at(t1, X) - self.displacements_at(t0, X)

    def velocities_at(self, t: float, dt: float, X: Array, x: Array) -> Array:
        """Prescribed velocities of points just after t [s], likewise [m/s].

        Reference positions are X, places at t are x; dt scales a difference quotient [s].
        """
        return np.zeros(3)

    def path_at(self, t: float) -> Array:
        """Its path in the components held, of all its nodes or some; equal on all ranks [m]."""
        return np.asarray(self.displacements_at(t, self.points)[..., list(self.axes)]).ravel()

    @property
    def points(self) -> Array:
        """Some points of its set, since it was checked."""
        return getattr(self, "_some", np.zeros((1, 3)))

    @property
    def keeps_rigid(self) -> bool:
        """Whether it may take a part named rigid along: its motion strains nothing."""
        return self.uniform

    def same_motion(self, other: Support) -> bool:
        """Whether both prescribe the same motion, as at rest, so that they may share nodes."""
        return not (self.moves or other.moves)

    def check(self, scene: Any) -> None:
        """See whether its path can be used; the scene knows its nodes already."""
        if not self.uniform:
            self._check_field(scene)
            return
        start, X = self.since if isfinite(self.since) else 0.0, self.points
        check_vector(scene, self.owner, start, lambda: self.displacements_at(start, X))
        check_vector(scene, self.owner, start, lambda: self.velocities_at(start, 1.0, X, X))

    def _check_field(self, scene: Any) -> None:
        nodes = next(nodes for support, nodes in scene.supports if support is self)
        X = scene.space.tabulate_dof_coordinates()[nodes]
        object.__setattr__(self, "_some", some_points(scene, nodes))

        def check() -> None:
            check_values(self.owner, self.start, X, self.displacements_at(self.start, X))
            check_values(self.owner, self.start, X, self.velocities_at(self.start, 1.0, X, X))

        together(scene.comm, f"{self.owner}: its function of place and time", check)

    def check_run(self, scene: Any, t_end: float) -> None:
        """Raise `SceneError` on every rank if its motion cannot be used in a run. Collective."""


@dataclass(frozen=True)
class Fixed(Support):
    """Holds the nodes of a named set where they are when the window begins."""


@dataclass(frozen=True)
class Symmetry(Fixed):
    """Holds the nodes of a plane in the direction of its normal, which is x, y or z.

    It is the plane of the nodes after an `InitialDisplacement`.

    Loads, reactions and energies are those of the modelled half. Give half of a force that acts in
    the plane itself. A `RigidFace` that the plane cuts, such as half of a hole, moves along the
    plane and turns about its normal only. A joint of the name "Symmetry on 'plane' - RigidFace
    'hole'" holds it, and tells its force.

    Attributes:
        components: The normal: found by the scene.
    """

    components: str = field(default="xyz", init=False)

    def placed(self, scene: Any) -> Symmetry:
        """The same with the normal of its plane, as that lies at the start. Collective.

        `SceneError` if the set is unknown, or no plane with the normal x, y or z.
        """
        nodes = scene.nodes(self.where, self.kind, (2,))
        X = scene.start_places[nodes]
        low, high = scene.box_of(X)
        extent = high - low
        size = float(np.max(np.nan_to_num(extent, posinf=0.0, neginf=0.0)))
        flat = np.flatnonzero(extent <= FLAT * max(size, np.abs([low, high]).max()))
        if len(flat) != 1:
            raise SceneError(
                f"{self.owner}: its facets must lie in one plane whose normal is x, y or z; they "
                f"reach from {tuple(low.tolist())} to {tuple(high.tolist())} m at the start."
            )
        return self._with(components="xyz"[int(flat[0])])


@dataclass(frozen=True)
class ResolvedForces(Effect):
    """Reactions, forces of joints and torques of motors without vibration faster than Δt.

    Flexible parts that start or are struck vibrate in all frequencies that their cells have. Those
    far above 1/Δt alternate from step to step for ever, and reactions with them. With this effect
    reports, files and peaks have the forces of the motion that Δt resolves: of a vibration with n
    steps a period 0.99 at n = 10, 0.997 at 13. The motion, its energy and its work stay as they
    are; `report.impulse` has the rest. Each step takes one tangent, with its factors, more.
    """


def slope_after(path: Callable[[float], Any], t: float, dt: float) -> Any:
    """One-sided difference quotient of second order just after t [s], by a thousandth of dt [s]."""
    h = 1e-3 * dt
    u0, u1, u2 = (path(t + k * h) for k in range(3))
    return (4 * u1 - 3 * u0 - u2) / (2 * h)
