"""How shadows move: from step to step, from one division of the cells to the next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.mechanics.rigid_body import RigidBody

__all__ = ["Limits", "Motion", "Strained", "at_rest", "frozen_velocities", "part_of"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass
class Motion:
    """The motion of the shadows, in the bodies' frames, shape (nodes, 3).

    Attributes:
        u: δ [m].
        v: δ̇ [m/s].
        w: Its mean over the last step [m/s]; NaN where there was none.
        still: K⁺ρ of the last step [m]; NaN where there is none yet.
        mean: Its mean over the time before, in which recent steps count most [m]; NaN likewise.
    """

    u: Array
    v: Array
    w: Array
    still: Array
    mean: Array

    def grown(self, rows: Sequence[Ints], still: Array, dt: float) -> Motion:
        """The motion before a step, of bodies that have just grown that under the forces alone.

        At the middle of the step they are strained as these would; were they so at its start, the
        step would throw them back.

        Args:
            rows: Rows of these bodies' nodes.
            still: K⁺ρ, shape (nodes, 3) [m].
            dt: Length of the step [s].
        """
        u = self.u.copy()
        for at in rows:
            u[at] = still[at] - dt / 2 * self.v[at]
        return replace(self, u=u)


@dataclass(frozen=True)
class Limits:
    """What wakes cells.

    Attributes:
        rates: Strain rates, of each owned cell [1/s]; None on all ranks if these wake nothing.
        strains: Strains that are withheld since the freeze, likewise.
        window: Length of a window [s]; infinite while that is not known.
        swings: Strains of shadows themselves, likewise; None if these need not be looked at.
        bends: Displacements that bend the body, likewise [m]; None if these need not be.
        reached: How close the last look came to waking any cell, for the shadows' pace: one if it
            did; None if that is what the cell that is closest has reached.
    """

    rates: Array | None
    strains: Array
    window: float
    swings: Array | None = None
    bends: Array | None = None
    reached: float | None = None


@dataclass(frozen=True)
class Strained:
    """What cells of bodies would strain, over what wakes them; zero outside bodies.

    Attributes:
        rate: Largest strain rate of each owned cell.
        sum: Strain that it has withheld since the freeze.
        spring: Strain rate at which it would spring into that in the step, were it released.
        swing: Strain of its shadow; None if that was not looked at.
        bend: Largest displacement of its nodes beyond the body's rigid motion; likewise.
        withheld: Strain energy ½ ρᵀK⁺ρ that the body of each part named rigid withholds, by the
            part's name, on all ranks [J]; empty before a step is solved.
        by_rates: Whether rates wake cells.
        window: Length of a window [s]; infinite while that is not known.
    """

    rate: Array
    sum: Array
    spring: Array
    swing: Array | None = None
    bend: Array | None = None
    withheld: Mapping[str, float] = field(default_factory=dict)
    by_rates: bool = True
    window: float = np.inf

    @property
    def ratio(self) -> Array:
        """The largest of them."""
        found = np.maximum(self.rate, self.sum)
        for other in (self.swing, self.bend):
            found = found if other is None else np.maximum(found, other)
        return found

    def largest(self, comm: MPI.Intracomm) -> Array:
        """The largest rate, and the largest of what adds up, shape (2,). Collective."""
        sums = [of.max(initial=0.0) for of in (self.sum, self.swing, self.bend) if of is not None]
        out = np.array([self.rate.max(initial=0.0), max(sums)])
        comm.Allreduce(MPI.IN_PLACE, out, op=MPI.MAX)
        return out


def at_rest(nodes: int, *, known: bool = False) -> Motion:
    """A motion of so many nodes of which nothing is known, or that there was and is none."""
    u, v = np.zeros((2, nodes, 3))
    w, still, mean = np.full((3, nodes, 3), 0.0 if known else np.nan)
    return Motion(u, v, w, still, mean)


def frozen_velocities(body: RigidBody) -> Array:
    """What the freeze has taken out of the motion of the body's nodes [m/s]."""
    out = np.zeros((body.nodes.size, 3))
    own = np.isin(body.frozen.nodes, body.nodes)
    out[np.searchsorted(body.nodes, body.frozen.nodes[own])] = body.frozen.velocities[own]
    return out


def part_of(strain: Array, limit: Array) -> Array:
    """What part of a limit it is; nothing is no part of any, and a failed solve exceeds all."""
    out = np.zeros_like(strain)
    some = ~(strain == 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        out[some] = np.nan_to_num(strain[some] / limit[some], nan=np.inf, posinf=np.inf)
    return out
