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
from rigidfx.errors import SceneError, agree
from rigidfx.scene import Scene

__all__ = ["NodalLoads"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class WeightedLoad:
    """A load and its nodal weights.

    Attributes:
        load: The effect.
        weights: Weight of each owned node: area [m²], volume [m³], mass [kg] or share [1].
    """

    load: fx.DeadLoad
    weights: Array


class NodalLoads:
    """Sum of dead loads on a scene."""

    def __init__(self, scene: Scene, loads: Sequence[fx.DeadLoad]) -> None:
        """Assemble the weights. Collective.

        Args:
            scene: The problem.
            loads: Loads to be added up.
        """
        self._comm = scene.comm
        n = scene.owned_nodes
        self._loads = [WeightedLoad(load, _weights(scene, load)[:n].copy()) for load in loads]

    def __bool__(self) -> bool:
        """Whether there is any load."""
        return bool(self._loads)

    def evaluate(self, t: float, out: PETSc.Vec) -> None:
        """Nodal forces at time t. Collective.

        Args:
            t: Time [s], the midpoint of a step.
            out: Full-length vector, overwritten [N].

        Raises:
            SceneError: On every rank, if a load's value is not three finite numbers on any.
        """
        forces = out.array.reshape(-1, 3)
        forces[:] = 0.0
        if not self._loads:
            return
        problem = None
        for item in self._loads:
            q = item.load.intensity(t)
            if q.shape == (3,) and np.isfinite(q).all():
                if q.any():
                    forces += item.weights[:, None] * q
            elif problem is None:
                where = getattr(item.load, "where", None) or "all cells"
                problem = (
                    f"{type(item.load).__name__} on '{where}': at t = {t:g} s three finite "
                    f"components are expected, got {q}. Check its value and time function."
                )
        agree(self._comm, problem)


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
