"""The least damping of a structure: α M + β K is below all of it.

A vibration of ω falls by ½ (α + β ω²), whatever its shape. Damping in some cells only may leave
others ringing, and counts for nothing. β is the least of all cells: of `KelvinVoigt` η over the
largest modulus 3 λ + 2 μ, of `NumericalDamping` ξ Δt. Both are zero where a structure may come to
rest elsewhere: unless it is of one part, supports hold it, it touches nothing, and is damped for
the whole run.
"""

from collections.abc import Iterator
from math import inf
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx import effects as fx
from rigidfx.base.types import Array
from rigidfx.effects.supports import Support
from rigidfx.mechanics.materials import Isotropic
from rigidfx.mechanics.schemes import rest_moduli
from rigidfx.scene.scene import Scene

DAMPING = fx.KelvinVoigt, fx.MassDamping, fx.NumericalDamping, fx.StiffnessDamping
SPREAD = 1e-6  # of nodes that are held, the second axis over the first, squared: they form no line


def holding(scene: Scene) -> list[Support]:
    """Supports that by themselves hold a structure of one part all the time. Collective."""
    if scene.parts.count > 1:
        return []
    X, n = scene.space.tabulate_dof_coordinates(), scene.owned_nodes
    found: list[Support] = []
    for support, nodes in scene.supports:
        if len(support.axes) < 3 or not always(support):
            continue
        x = X[nodes[nodes < n]]
        ones = np.hstack([np.ones((len(x), 1)), x])
        moments = np.asarray(scene.sum(ones.T @ ones))
        centre = moments[0, 1:] / moments[0, 0]
        spread = np.linalg.eigvalsh(moments[1:, 1:] / moments[0, 0] - np.outer(centre, centre))
        if spread[1] > SPREAD * spread[2]:
            found.append(support)
    return found


def always(effect: fx.Windowed) -> bool:
    """Whether an effect acts from the start to the end."""
    return effect.since <= 0 and effect.until == inf


class Damped:
    """The least damping of a scene in which all of it acts from the start to the end.

    Attributes:
        drag: α [1/s].
        viscous: β, but for numerical damping [s].
        numerical: ξ.
    """

    def __init__(self, scene: Scene) -> None:
        """Look the damping of each cell up. Collective."""
        self.drag = self.viscous = self.numerical = 0.0
        if not comes_back(scene):
            return
        self.drag = float(sum(effect.mass_damping for effect in scene.named(fx.MassDamping)))
        self.numerical = float(sum(e.numerical_damping for e in scene.named(fx.NumericalDamping)))
        beta: Array = np.zeros(scene.owned_cells(None, "").size)
        for effect in scene.named(fx.StiffnessDamping):
            beta[scene.owned_cells(effect.where, effect.kind)] += effect.beta
        for effect in scene.named(fx.KelvinVoigt):
            inside = scene.owned_cells(effect.where, effect.kind)
            for modulus, cells in _moduli(scene):
                beta[np.intersect1d(cells, inside)] += float(effect.eta) / modulus
        self.viscous = float(scene.comm.allreduce(beta.min(initial=np.inf), op=MPI.MIN))
        if scene.named(fx.Spring) or scene.named(fx.SpringDamper):
            self.viscous = self.numerical = 0.0

    def rates(self, frequencies: Array, dt: float) -> Array:
        """Parts of vibrations' sizes taken per time [1/s], by ω of each [1/s] and Δt [s]."""
        beta = self.viscous + self.numerical * dt
        return np.asarray(0.5 * (self.drag + beta * frequencies**2))


def _moduli(scene: Scene) -> Iterator[tuple[float, Any]]:
    """The largest modulus of each material at rest [Pa], infinite if unknown; its cells."""
    for material, cells in scene.materials:
        moduli = rest_moduli(material) if isinstance(material, Isotropic) else None
        lmbda, mu = moduli or (0.0, np.inf)
        yield max(3 * lmbda, 0.0) + 2 * mu, cells


def comes_back(scene: Scene) -> bool:
    """Whether a structure has but one place to come to rest in. Collective."""
    damping = [effect for kind in DAMPING for effect in scene.named(kind)]
    if scene.named(fx.Contact) or not all(map(always, damping)):
        return False
    return bool(holding(scene))
