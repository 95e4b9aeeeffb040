"""Dead loads per volume, area and on nodes: a nodal weight times a force in time, fᵢ(t) = wᵢ q(t).

The weights are assembled once per division, those on the nodes of a body to their sums; a step
only evaluates q at its midpoint. A load that depends on the place, q(X, t), is evaluated at all
nodes it acts on, and has its sums over the nodes of bodies anew in each step.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import is_function, numbers, vector
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.effects.action import Action, Structure
from rigidfx.effects.attached.point_mass import PointMass
from rigidfx.effects.base import (
    ANY_SET,
    NO_VECTOR,
    PlaceAndTime,
    Scaled,
    Vector,
    check_values,
    is_truth,
    mean_over,
    must_be,
    of_place,
    values_at,
    vector_at,
)
from rigidfx.effects.nodes import Forces, Nodes
from rigidfx.mechanics.rigid_body import RigidBody


@dataclass(frozen=True)
class DeadLoad(Scaled):
    """A load whose direction in space does not follow the body."""

    is_dead: ClassVar[bool] = True
    dims: ClassVar[tuple[int, ...]] = (3,)  # of the sets it may act on
    local: ClassVar[bool] = False  # whether its value may depend on the place

    def __post_init__(self) -> None:
        """Raise `SceneError` if window, value or time function cannot be used."""
        super().__post_init__()
        value = getattr(self, "value", None)
        if not is_function(value):
            vector(self.kind, "value", value)
        elif of_place(value) and not self.local:
            raise SceneError(
                f"{self.owner}: value must be a function of t; one of x and t can be had with "
                "Traction and BodyForce."
            )

    @cached_property
    def uniform(self) -> bool:  # type: ignore[override]
        """Whether its value is the same everywhere."""
        return not of_place(getattr(self, "value", None))

    def intensity(self, t: float, X: Any = None) -> Array:
        """Vector q(t), shape (3,), that multiplies the nodal weights; zero outside the window.

        Of a function of place, vectors at reference positions X [m], shape (points, 3).
        """
        if not self.acts(t):
            return np.zeros(3 if self.uniform else X.shape)
        value: Any = getattr(self, "value", NO_VECTOR)
        if not self.uniform:
            value = values_at(value, X, t)
        return np.asarray(numbers(value(t) if is_function(value) else value) * self.factor(t))

    def weights(self, scene: Any) -> Array:
        """Weight of each local node: area [m²], volume [m³], mass [kg] or share [1]. Collective."""
        raise NotImplementedError

    def check(self, scene: Any) -> None:
        """Look its set up, and see whether its function of time can be used."""
        where = getattr(self, "where", None)
        if where is not None:
            scene.domain.find(where, self.dims, self.kind)
        self.check_functions(
            scene,
            lambda: np.flatnonzero(self.weights(scene)).astype(np.int32),
            partial(self.intensity, self.start),
        )

    def signal(self, t: float, dt: float) -> Array:
        """The intensity; of one that depends on the place at some points."""
        return self.intensity(t, self.points).ravel()

    def bind(self, structure: Structure) -> Action:
        """The forces on nodes and bodies."""
        return DeadForces(self, structure) if self.uniform else FieldForces(self, structure)


@dataclass(frozen=True)
class BodyForce(DeadLoad):
    """Dead force per reference volume [N/m³].

    It acts on volumes. It neglects each `PointMass` and the given mass of a `Rigid` part, and warns
    of them. Weight is `Gravity`.

    Attributes:
        value: Three components [N/m³], or a function t giving them, or a function x, t of
            reference positions of shape (3, n) [m] giving shape (3, n).
        where: Name of a set of cells; everywhere if None.
    """

    local: ClassVar[bool] = True

    value: Vector | PlaceAndTime
    where: str | None = None

    def weights(self, scene: Any) -> Array:
        """Volume of each node [m³]."""
        return scene.cell_weights(1.0, scene.owned_cells(self.where, self.kind))

    def check(self, scene: Any) -> None:
        """Check set and function; warn of masses that it passes by. Collective."""
        super().check(scene)
        n = scene.owned_nodes
        loaded = self.weights(scene)[:n] != 0.0
        passed = scene.sum(scene.point_masses[:n][loaded].sum())
        cells = scene.owned_cells(self.where, self.kind)
        for rigid in (e for e in scene.effects if e.is_rigid and e.given and e.mass is not None):
            shared = np.intersect1d(cells, scene.owned_cells(rigid.where, self.kind)).size
            passed += float(rigid.mass) if scene.sum(shared) > 0 else 0.0
        if passed > 0:
            warn(
                scene.comm,
                f"{self.owner}: a force per volume does not act on {passed:.6g} kg of point masses "
                "and of Rigid parts of given mass at its nodes. If it is meant as weight, take "
                "Gravity, which acts on all mass.",
            )


@dataclass(frozen=True)
class Traction(DeadLoad):
    """Dead traction on named facets, per reference area [Pa].

    Attributes:
        where: Name of a set of facets.
        value: Three components [Pa], or a function t giving them, or a function x, t of
            reference positions of shape (3, n) [m] giving shape (3, n).
        total: Whether values are the total force [N], spread evenly over the area; for a function
            of place its mean is the resultant.
    """

    dims: ClassVar[tuple[int, ...]] = (2,)
    local: ClassVar[bool] = True
    checks: ClassVar[Checks] = DeadLoad.checks | {
        "total": must_be("True or False, the force being its value", is_truth)
    }

    where: str
    value: Vector | PlaceAndTime
    total: bool = field(default=False, kw_only=True)

    def weights(self, scene: Any) -> Array:
        """Area of each node [m²], or its part of the whole area [1]."""
        areas = scene.facet_weights(self.where, self.kind)
        return areas / scene.sum(areas[: scene.owned_nodes].sum()) if self.total else areas


@dataclass(frozen=True)
class NodalForce(DeadLoad):
    """A total force spread in equal parts over the nodes of a named set.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        value: Three components of the *total* force [N], or a function of time giving them.
    """

    dims: ClassVar[tuple[int, ...]] = ANY_SET

    where: str
    value: Vector | Callable[[float], Vector]

    def weights(self, scene: Any) -> Array:
        """Share of each node [1]."""
        return scene.shares(self.where, self.kind)


@dataclass(frozen=True)
class Gravity(DeadLoad):
    """Uniform acceleration field: force m g on all mass of the nodes it acts on.

    The force of cells is ρ0 g per reference volume. Each `PointMass` on nodes of these cells has
    its weight, too, and a `Rigid` part of given mass has the weight of that mass.

    Attributes:
        value: Acceleration g, three components [m/s²], or a function of time giving them.
        where: Name of a set of cells; everywhere if None.
    """

    value: Vector | Callable[[float], Vector] = (0.0, 0.0, -9.81)
    where: str | None = None

    def weights(self, scene: Any) -> Array:
        """Mass of the loaded cells at each node, and its point masses [kg]. Collective."""
        weights = scene.cell_weights(scene.density(), scene.owned_cells(self.where, self.kind))
        return weights + scene.point_masses * self._members(scene) + self._at_faces(scene)

    def _at_faces(self, scene: Any) -> Array | float:
        """Masses at points of faces, by the weights of the nodes that move them. Collective."""
        out = np.zeros(len(scene.point_masses))
        for effect in (e for e in scene.named(PointMass) if e.face is not None):
            place = effect.remote.place
            if not effect.is_carried and self._acts_on(scene, effect):
                out[place.nodes] += float(effect.mass) * place.weights
        return out

    def _acts_on(self, scene: Any, effect: PointMass) -> bool:
        """Whether all nodes of the face of a mass are in its cells. Collective."""
        missing = np.count_nonzero(self._members(scene)[effect.remote.place.nodes] == 0.0)
        return bool(scene.sum(missing) == 0)

    def _members(self, scene: Any) -> Array:
        """1 at the nodes of its cells, 0 elsewhere, per local node. Collective."""
        return np.asarray(scene.members(self.where, self.kind)[:, 0])

    def check(self, scene: Any) -> None:
        """Check its set, and that no other one loads the same point mass too. Collective."""
        super().check(scene)
        others = [e for e in scene.named(Gravity) if e.where not in (None, self.where)]
        for other in others if self.where is not None else ():
            both = scene.point_masses * self._members(scene) * other._members(scene)
            if scene.sum(both[: scene.owned_nodes].sum()) > 0:
                raise SceneError(
                    f"Gravity: '{self.where}' and '{other.where}' both hold nodes of a PointMass, "
                    "which would weigh twice. Name one set that holds all of them."
                )

    def moments(self, structure: Structure, weights: Array) -> Array:
        """As of any dead load, but bodies whose mass is given weigh that mass."""
        once = structure.once
        out = super().moments(structure, weights)
        carried = {e.title: e for e in structure.scene.named(PointMass) if e.is_carried}
        for k, body in enumerate(structure.bodies.of.records):
            if body.name in carried:
                acts = self._acts_on(structure.scene, carried[body.name])
                out[k, 0] = once * body.mass if acts else 0
            elif body.given:
                given = once * self._given(structure.scene, body)
                out[k, : given.size] = given
        return out

    def _given(self, scene: Any, body: RigidBody) -> Array:
        """Σ w a of a body whose mass is given, shape (n,) [kg, kg m]. Collective.

        The loaded part of its cells' weight, scaled to that mass, acts at the centre of mass. It
        stands for all lumped mass on its nodes; a consistent one of flexible cells comes on top.
        """
        where, own = scene.owned_cells(self.where, self.kind), body.cells
        beside = np.setdiff1d(where, own) if scene.mass == "consistent" else own[:0]
        parts = own, np.intersect1d(where, own), beside
        sums = []
        for cells in parts:
            w = scene.cell_weights(scene.density(), cells)[: scene.owned_nodes]
            sums.append(w[body.nodes] @ body.coordinates())
        whole, acting, others = np.asarray(scene.sum(np.stack(sums)))
        share = acting[0] / whole[0]
        coordinates = (acting - share * whole) / whole[0]
        coordinates[0] = share
        return np.asarray(body.mass * coordinates + others)


class DeadForces(Action):
    """A dead load on the nodes of a division, and on its bodies by sums over their nodes.

    It may be any effect with the `weights`, `moments` and `intensity` of a `DeadLoad`.
    """

    def __init__(self, load: Any, structure: Structure) -> None:
        """Assemble the weights. Collective."""
        self.kind, self._load = load.kind, load
        weights = load.weights(structure.scene)[: structure.scene.owned_nodes]
        self._moments = load.moments(structure, weights)
        self._weights = np.where(structure.own, weights[structure.rows.nodes], 0.0)[:, None]
        self._q: Array = np.zeros(3)
        self._over = structure.over

    def set_time(self, t: float, dt: float) -> None:
        """Evaluate q; `SceneError` on this rank, unless it is three finite numbers."""
        load = self._load

        def q(t: float) -> Array:
            return vector_at(load.owner, "value or time function", t, lambda: load.intensity(t))

        self._q = mean_over(q, t, self._over(dt))

    def load(self, forces: Forces) -> None:
        """Add w q, and Σ w a qᵀ of bodies."""
        if self._q.any():
            forces.nodes[...] += self._weights * self._q
            forces.moments[...] += self._moments[:, :, None] * self._q


class FieldForces(Action):
    """A dead load that depends on the place, on the nodes of a division and on its bodies."""

    def __init__(self, load: DeadLoad, structure: Structure) -> None:
        """Assemble the weights. Collective."""
        self.kind, self._load = load.kind, load
        weights = load.weights(structure.scene)[: structure.scene.owned_nodes]
        self.nodes = nodes = Nodes(structure, np.flatnonzero(weights))
        self._weights = weights[nodes.nodes, None]
        self._X = structure.scene.space.tabulate_dof_coordinates()[nodes.nodes]
        self._forces: Array = np.zeros((len(nodes), 3))
        self._over = structure.over

    def set_time(self, t: float, dt: float) -> None:
        """Evaluate q at the nodes; `SceneError` on this rank, unless it is finite vectors."""
        load, X = self._load, self._X

        def q(t: float) -> Array:
            return check_values(load.owner, t, load.intensity(t, X), X)

        self._forces = self._weights * mean_over(q, t, self._over(dt))

    def load(self, forces: Forces) -> None:
        """Add w q."""
        self.nodes.add(self._forces, forces)
