"""Contact of a named surface: other things stay outside of it."""

from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError, together
from rigidfx.base.inputs import at_least_zero, positive
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array, Ints
from rigidfx.base.warning import warn
from rigidfx.effects.action import Action, Structure
from rigidfx.effects.base import Windowed, must_be
from rigidfx.effects.contacts.obstacles import Friction, Obstacle, ObstacleForces
from rigidfx.effects.contacts.pairs import PairForces, PairSurface, pair_of, refuse_overlap
from rigidfx.effects.contacts.surface import ContactSurface, surface_of

NEGLIGIBLE = 1e-6  # of the distance of nodes: overlap at the start that is not worth a word
TOO_DEEP = 0.5, 0.1  # of it: overlap that is refused, with an obstacle and with a surface


@dataclass(frozen=True)
class Contact(Windowed):
    """Keeps a surface out of an obstacle, by an elastic penalty that conserves energy.

    The nodes of the surface store ½ k A g₋², A being their areas and g their gaps. Energy,
    with the part stored in the contact, is exact at any time step. A body is pressed at its nodes.

    Attributes:
        where: Name of a set of boundary facets.
        against: A `Plane`, `Sphere` or `Cylinder`, at rest or moving; or the name of another set of
            boundary facets, which nodes of `where` may not pass; or the name of `where` itself, for
            a surface that may touch itself.
        stiffness: k [N/m³]; five times that of a layer of the cells behind if None.
        friction: Coefficient of Coulomb friction μ ≥ 0.
        creep: Speed ε below which sticking nodes creep [m/s]; to be given with friction.
        title: Name in reports and tables; made of both sides if None.
    """

    is_load: ClassVar[bool] = True
    is_contact: ClassVar[bool] = True
    checks: ClassVar[Checks] = {
        "against": must_be(
            "a Plane or another obstacle, or the name of a set",
            lambda given: isinstance(given, (Obstacle, str)),
        ),
        "title": must_be(
            "a text that can be printed",
            lambda given: isinstance(given, str) and given.isprintable(),
        ),
        "stiffness": positive,
        "friction": at_least_zero,
        "creep": positive,
    }

    where: str
    against: Obstacle | str = field(kw_only=True)
    stiffness: float | None = field(default=None, kw_only=True)
    friction: float = field(default=0.0, kw_only=True)
    creep: float | None = field(default=None, kw_only=True)
    title: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        """Raise `SceneError` if window, obstacle or a number cannot be used."""
        super().__post_init__()
        if self.creep is None and self.friction > 0:
            raise SceneError(
                f"{self.owner}: friction needs creep, the speed [m/s] below which what sticks may "
                "creep; a thousandth of the speeds that matter, say."
            )
        other = self.against if isinstance(self.against, str) else self.against.kind.lower()
        if isinstance(self.against, str) and self.friction:
            raise SceneError(f"{self.owner}: friction is for obstacles, not for '{other}' yet.")
        if not self.title:
            object.__setattr__(self, "title", f"{self.where}_{other}")

    @property
    def keeps_apart(self) -> tuple[str, ...]:  # type: ignore[override]
        """Its surface and the other one; () if it meets an obstacle."""
        return (self.where, self.against) if isinstance(self.against, str) else ()

    def friction_in(self, dt: float) -> Friction | None:
        """Friction in a step of length dt [s]; None without."""
        if not self.friction or self.creep is None:
            return None
        return Friction(float(self.friction), float(self.creep) * dt)

    def check(self, scene: Any) -> None:
        """Look its facets up, and see where they are at the start. Collective."""
        if [contact.title for contact in scene.named(Contact)].count(self.title) > 1:
            raise SceneError(
                f"{self.owner}: two contacts are called '{self.title}'; give one another title."
            )
        surface, against, start = self._surface(scene), self.against, self.start
        if against == self.where:
            if self._pair(scene).flat:
                raise SceneError(f"{self.owner}: '{against}' is flat, so it does not meet itself.")
            refuse_overlap(scene, self.where, self.owner)
        if isinstance(against, Obstacle):
            on = np.flatnonzero(surface.area).astype(np.int32)
            self.check_functions(scene, lambda: on, lambda X: against.displacement(start))
            X = scene.space.tabulate_dof_coordinates()[on]
            y = X - against.displacement(start)
            self._ask(scene, "gap", y)
            self._ask(scene, "approach", y, y)
            self._ask(scene, "outward", y)
        if start <= 0.0:  # else its place is unknown yet
            self._check_depth(scene, surface.size)

    def _check_depth(self, scene: Any, size: float) -> None:
        """Refuse or warn of an overlap at the start, by the distance of nodes [m]. Collective."""
        worst, place = self.depth(scene, scene.start_places, self.start)
        if worst <= NEGLIGIBLE * size:
            return
        (x, y, z), against = place, self.against
        is_set = isinstance(against, str)
        other = f"'{against}'" if isinstance(against, str) else f"the {against.kind}"
        found = (
            f"{self.owner}: at the start it is {worst:.3g} m inside {other} at "
            f"({x:.6g}, {y:.6g}, {z:.6g}) m"
        )
        if worst > TOO_DEEP[is_set] * size:
            raise SceneError(f"{found}: move one of them, or turn the normal or inside around.")
        begins = "there" if is_set else "with the energy of that"
        warn(scene.comm, f"{found}; the contact begins {begins}.")

    def _surface(self, scene: Any) -> ContactSurface:
        """Its surface. Collective."""
        return surface_of(scene, self.where, self.stiffness, self.owner)

    def _ask(self, scene: Any, name: str, *points: Array) -> Any:
        """What its obstacle gives at points. Collective."""
        asked: Any = partial(self.against.asked, self.owner, name, *points)  # type: ignore[union-attr]
        return together(scene.comm, f"{self.owner}: its obstacle", asked)

    def _pair(self, scene: Any) -> PairSurface:
        """Its surface and the other one. Collective."""
        return pair_of(scene, self.where, str(self.against), self.stiffness, self.owner)

    def depth(self, scene: Any, x: Array, t: float) -> tuple[float, tuple[float, ...]]:
        """Greatest depth [m] at t, and its place, nodes at x; -inf if it meets none. Collective."""
        on, gap, _ = self.at_nodes(scene, x, t)
        own = on < scene.owned_nodes
        x, depth = x[on[own]], -gap[own]
        k = int(np.argmax(depth)) if depth.size else -1
        mine = (float(depth[k]), tuple(x[k].tolist())) if depth.size else (-np.inf, ())
        return max(scene.comm.allgather(mine))

    def at_nodes(self, scene: Any, x: Array, t: float) -> tuple[Ints, Array, Array]:
        """Nodes (near another surface), gaps [m], pressures [Pa] at t, nodes at x. Collective."""
        surface = self._surface(scene)
        on = np.flatnonzero(surface.area > 0) if self.acts(t) else np.empty(0, np.int64)
        if isinstance(self.against, str):
            pair = self._pair(scene)
            near, gap = pair.gaps(scene.comm, x)
            own = np.isin(near, pair.numbers) & self.acts(t)
            on, gap = pair.nodes[np.searchsorted(pair.numbers, near[own])], gap[own]
        else:
            gap = self._ask(scene, "gap", x[on] - self.against.displacement(t))
        pressure = surface.stiffness[on] / surface.area[on] * np.maximum(-gap, 0.0)
        return on, gap, pressure

    def directions(self, scene: Any) -> tuple[Ints, Array]:
        """Owned nodes of its surface, and directions in which an obstacle resists. Collective.

        One direction of each at the start, all three with friction, shape (nodes, 1 or 3, 3).
        """
        surface, against = self._surface(scene), self.against
        on = np.flatnonzero(surface.area[: scene.owned_nodes] > 0)
        if self.friction or isinstance(against, str):
            return on, np.broadcast_to(np.eye(3), (on.size, 3, 3))
        y = scene.start_places[on] - against.displacement(0.0)
        return on, self._ask(scene, "outward", y)[:, None, :]

    def bind(self, structure: Structure) -> Action | None:
        """Its forces on nodes and bodies."""
        scene, against = structure.scene, self.against
        if isinstance(against, Obstacle):
            return ObstacleForces(self, against, self._surface(scene), structure)
        if structure.notes is None:
            return None  # the other surface is not there
        return PairForces(self, self._pair(scene), structure)
