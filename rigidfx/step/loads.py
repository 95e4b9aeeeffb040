"""Dead loads as nodal weights times a force in time: assembled once, nothing per step but q(t)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from petsc4py import PETSc

from rigidfx import effects as fx
from rigidfx.base.errors import SceneError, together
from rigidfx.mechanics.body_step import Increments
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.scene.scene import Scene

__all__ = ["NodalLoads", "Resultants"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class WeightedLoad:
    """A load and its nodal weights.

    Attributes:
        load: The effect.
        weights: Weight of each node: area [m²], volume [m³], mass [kg] or share [1].
        arms: Σ w and Σ w V over each body's nodes, shape (bodies, 4).
    """

    load: fx.DeadLoad
    weights: Array
    arms: Array


@dataclass(frozen=True)
class Resultants:
    """Dead loads on the rigid bodies at one time.

    Attributes:
        moments: Σ f and Σ V fᵀ over the nodes of each, V in its frame, shape (bodies, 4, 3)
            [N, N m].
        torques: Torques in space that act on the bodies as such, shape (bodies, 3) [N m].
    """

    moments: Array
    torques: Array

    def work(self, increments: Increments) -> float:
        """Work in a step [J]."""
        forces = increments.resultant(self.moments)
        return increments.work(forces) + float(np.vdot(self.torques, increments.theta))


class NodalLoads:
    """Sum of dead loads on a scene: on free nodes one by one, on bodies by their resultants.

    Attributes:
        loads: The loads that act, with their nodal weights.
    """

    def __init__(
        self,
        scene: Scene,
        loads: Sequence[fx.DeadLoad],
        nodes: npt.NDArray[np.int32],
        bodies: Sequence[RigidBody] = (),
        torques: Sequence[fx.Resultant] = (),
    ) -> None:
        """Assemble the weights. Collective.

        Args:
            scene: The problem.
            loads: Loads to be added up.
            nodes: Owned nodes, among them all that belong to no body.
            bodies: Rigid bodies; loads on their nodes are kept as resultants.
            torques: Force and torque resultants on bodies.
        """
        self._comm = scene.comm
        n = scene.owned_nodes
        self._every: list[WeightedLoad] = []
        self._bodies, self._torques = bodies, torques
        for load in loads:
            weights = _weights(scene, load)[:n].copy()
            sums = [np.r_[weights[b.nodes].sum(), weights[b.nodes] @ b.offsets] for b in bodies]
            for b in bodies:
                weights[b.nodes] = 0.0
            arms = np.asarray(scene.sum(np.reshape(sums, (-1, 4))))
            if isinstance(load, fx.Gravity):
                for k, b in enumerate(bodies):
                    if b.given:
                        arms[k] = _weight(scene, load, b)
            self._every.append(WeightedLoad(load, weights[nodes], arms))
        self.select((*loads, *torques))

    def select(self, acting: Sequence[fx.Windowed]) -> None:
        """From now on let those act that are among the given effects; the others cost nothing."""
        here = {id(effect) for effect in acting}
        self.loads = [item for item in self._every if id(item.load) in here]
        torques = [t for t in self._torques if id(t) in here]
        self._on_bodies = [[t for t in torques if t.body == b.name] for b in self._bodies]
        self._twisted = any(self._on_bodies)
        # shape (bodies, 4, loads)
        arms = [item.arms for item in self.loads]
        shape = len(arms), len(self._bodies), 4
        self._arms = np.reshape(arms, shape).transpose(1, 2, 0)

    def evaluate(self, t: float, out: PETSc.Vec) -> Resultants:
        """Nodal forces and loads on the bodies at time t. Collective.

        Args:
            t: Time [s], the midpoint of a step.
            out: Three rows for each of the nodes, overwritten [N].

        Raises:
            SceneError: On every rank, if a load's value is not three finite numbers on any.
        """
        forces = out.array.reshape(-1, 3)
        forces[:] = 0.0
        q: list[Array] = []
        twists: Array = np.zeros((len(self._bodies), 2, 3))
        if self.loads or self._twisted:
            q, twists = together(self._comm, "A load", lambda: (self._q(t), self._twists(t)))
        for value, item in zip(q, self.loads, strict=True):
            if value.any():
                forces += item.weights[:, None] * value
        moments = self._arms @ np.reshape(q, (-1, 3))
        moments[:, 0] += twists[:, 0]
        return Resultants(moments, twists[:, 1])

    def _twists(self, t: float) -> Array:
        """Force and torque on each body as such at time t, shape (bodies, 2, 3).

        Raises:
            SceneError: On this rank, if one is not finite.
        """
        out: Array = np.zeros((len(self._bodies), 2, 3))
        for k, loads in enumerate(self._on_bodies):
            for load in loads:
                with np.errstate(invalid="ignore"):  # what is not finite is met below
                    own = np.stack([load.force_at(t), load.torque_at(t)])
                if not np.isfinite(own).all():
                    raise SceneError(
                        f"Resultant on '{load.body}': at t = {t:g} s force and torque are "
                        f"{own[0]} N and {own[1]} N m; check its time function."
                    )
                out[k] += own
        return out

    def _q(self, t: float) -> list[Array]:
        """Force vector of each load at time t, shape (3,); what a user's function does is checked.

        Raises:
            SceneError: On this rank, if one fails or is not three finite numbers.
        """
        out = []
        for load in (item.load for item in self.loads):
            name = f"{type(load).__name__} on '{getattr(load, 'where', None) or 'all cells'}'"
            try:
                q = load.intensity(t)
            except Exception as error:  # whatever a user's function may raise
                raise SceneError(
                    f"{name}: its value or time function failed at t = {t:g} s with "
                    f"{type(error).__name__}: {error}"
                ) from error
            if q.shape != (3,) or not np.isfinite(q).all():
                raise SceneError(
                    f"{name}: at t = {t:g} s three finite components are expected, got {q}. "
                    "Check its value and time function."
                )
            out.append(q)
        return out


def _weight(scene: Scene, load: fx.Gravity, body: RigidBody) -> Array:
    """Σ w and Σ w V of a body that weighs what it is told to, shape (4,) [kg, kg m]. Collective.

    Of its own mass as much counts as of that of its cells, all of it at its centre. It stands for
    all lumped mass on its nodes; of a consistent one what flexible cells have there comes on top.
    """
    where, own = scene.owned_cells(load.where, "Gravity"), body.cells
    beside = np.setdiff1d(where, own) if scene.mass == "consistent" else own[:0]
    parts = own, np.intersect1d(where, own), beside
    sums = []
    for cells in parts:
        w = scene.nodal_weights(scene.density(), _measure(scene, "dx", cells))[: scene.owned_nodes]
        sums.append(np.r_[w[body.nodes].sum(), w[body.nodes] @ body.offsets])
    whole, acting, others = np.asarray(scene.sum(np.stack(sums)))
    share = acting[0] / whole[0]
    arms = (acting - share * whole) / whole[0]
    arms[0] = share
    return np.asarray(body.mass * arms + others)


def _measure(scene: Scene, kind: str, where: Any) -> ufl.Measure:
    """The measure of loads over owned cells (dx), or owned cells and facets in them (ds)."""
    degree = {"quadrature_degree": 2 * scene.order + 2}
    return ufl.Measure(kind, domain=scene.mesh, metadata=degree, subdomain_data=[(1, where)])(1)


def _weights(scene: Scene, load: fx.DeadLoad) -> Array:
    where: Any = getattr(load, "where", None)
    if isinstance(load, fx.NodalForce):
        return scene.shares(where, "NodalForce")
    if isinstance(load, fx.Traction):
        pairs = scene.boundary(where, "Traction").reshape(-1)
        return scene.nodal_weights(1.0, _measure(scene, "ds", pairs))
    density = scene.density() if isinstance(load, fx.Gravity) else 1.0
    owned = scene.owned_cells(where, type(load).__name__)
    weights = scene.nodal_weights(density, _measure(scene, "dx", owned))
    heavy = isinstance(load, fx.Gravity) and where is None
    return weights + scene.point_masses if heavy else weights
