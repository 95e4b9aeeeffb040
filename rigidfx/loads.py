"""Dead loads as nodal weights times a force in time: assembled once, nothing per step but q(t)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from petsc4py import PETSc

from rigidfx import _compat
from rigidfx import effects as fx
from rigidfx.body import Increment, RigidBody
from rigidfx.errors import SceneError, together
from rigidfx.scene import Scene

__all__ = ["NodalLoads", "Resultants"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class WeightedLoad:
    """A load and its nodal weights.

    Attributes:
        load: The effect.
        weights: Weight of each node: area [m²], volume [m³], mass [kg] or share [1].
    """

    load: fx.DeadLoad
    weights: Array


@dataclass(frozen=True)
class Resultants:
    """Dead loads on one body at one time.

    Attributes:
        moments: Σ f and Σ V fᵀ over the body's nodes, V in the body's frame, shape (4, 3) [N, N m].
        torque: Torques in space that act on the body as such [N m].
    """

    moments: Array
    torque: Array

    def work(self, increment: Increment) -> float:
        """Work in a step [J]."""
        f = increment.resultant(self.moments)
        turning = f[3:] * increment.body.length + self.torque
        return float(f[:3] @ increment.dr + turning @ increment.theta)


class NodalLoads:
    """Sum of dead loads on a scene: on free nodes one by one, on bodies by their resultants."""

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
        self._loads, on_bodies = [], []
        self._torques = [[t for t in torques if t.body == b.name] for b in bodies]
        for load in loads:
            weights = _weights(scene, load)[:n].copy()
            sums = [np.r_[weights[b.nodes].sum(), weights[b.nodes] @ b.offsets] for b in bodies]
            for b in bodies:
                weights[b.nodes] = 0.0
            self._loads.append(WeightedLoad(load, weights[nodes]))
            on_bodies.append(np.asarray(scene.sum(np.reshape(sums, (-1, 4)))))
        # Σ w and Σ w V of each body and load, shape (bodies, 4, loads)
        self._arms = np.reshape(on_bodies, (len(loads), len(bodies), 4)).transpose(1, 2, 0)

    def evaluate(self, t: float, out: PETSc.Vec) -> tuple[Resultants, ...]:
        """Nodal forces and loads on each body at time t. Collective.

        Args:
            t: Time [s], the midpoint of a step.
            out: Three rows for each of the nodes, overwritten [N].

        Raises:
            SceneError: On every rank, if a load's value is not three finite numbers on any.
        """
        forces = out.array.reshape(-1, 3)
        forces[:] = 0.0
        q = together(self._comm, "A load", lambda: self._q(t)) if self._loads else []
        for value, item in zip(q, self._loads, strict=True):
            if value.any():
                forces += item.weights[:, None] * value
        values = np.reshape(q, (-1, 3))
        return tuple(
            _on_body(arms @ values, torques, t)
            for arms, torques in zip(self._arms, self._torques, strict=True)
        )

    def _q(self, t: float) -> list[Array]:
        """Force vector of each load at time t, shape (3,); what a user's function does is checked.

        Raises:
            SceneError: On this rank, if one fails or is not three finite numbers.
        """
        out = []
        for load in (item.load for item in self._loads):
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


def _on_body(moments: Array, torques: Sequence[fx.Resultant], t: float) -> Resultants:
    """Add what acts on a body as such to the moments of the loads on its nodes."""
    twist = np.zeros(3)
    for resultant in torques:
        moments[0] += resultant.force_at(t)
        twist += resultant.torque_at(t)
    return Resultants(moments, twist)


def _weights(scene: Scene, load: fx.DeadLoad) -> Array:
    degree = {"quadrature_degree": 2 * scene.order + 2}
    where: Any = getattr(load, "where", None)
    measure = partial(ufl.Measure, domain=scene.mesh, metadata=degree)
    if isinstance(load, fx.NodalForce):
        nodes = scene.nodes(where, "NodalForce")
        weights = np.zeros(scene.nodal_mass.size)
        weights[nodes] = 1.0
        return weights / scene.sum(weights[: scene.owned_nodes].sum())
    if isinstance(load, fx.Traction):
        facets = scene.domain.find(where, (2,), "Traction").entities
        pairs = _compat.integration_facets(scene.mesh, facets)
        inner = scene.domain.count(scene.domain.find(where, (2,), "Traction")) - scene.sum(
            len(pairs) // 2
        )
        if inner > 0:
            raise SceneError(
                f"Traction on '{where}': {int(inner)} of its facets lie inside the mesh; a dead "
                "traction needs boundary facets."
            )
        return scene.nodal_weights(1.0, measure("ds", subdomain_data=[(1, pairs)])(1))
    density = scene.density() if isinstance(load, fx.Gravity) else 1.0
    if where is None:
        return scene.nodal_weights(density, measure("dx"))
    cells = scene.domain.find(where, (3,), type(load).__name__).entities
    owned = cells[cells < scene.mesh.topology.index_map(3).size_local]
    return scene.nodal_weights(density, measure("dx", subdomain_data=[(1, owned)])(1))
