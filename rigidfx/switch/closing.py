"""Velocities that keep joints closed: the correction by impulses of the joints.

The velocities that keep joints closed, D Eᵀ y = 0, and are nearest to given ones in the metric of
the mass, are

    y - M⁻¹ E Dᵀ Λ,    (D Eᵀ M⁻¹ E Dᵀ) Λ = D Eᵀ y,

with impulses Λ of the joints and the ports Eᵀ of `rigidfx.coupling.ports`. With redundant rows Λ is
the least solution. Motors that prescribe a motion, locks among them, have a row each, with its
speed s on the right side: their impulses do the work Λ·s. Ports on parts that M does not couple
share a solve.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.errors import SceneError, together
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.coupling.ports import Ports
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects.joints.elements import Motor
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.scene.scene import Scene
from rigidfx.step.newton.border import parted


class Closing:
    """Corrects velocities for the joints, at fixed places."""

    def __init__(
        self,
        linkage: Linkage,
        prolongation: Prolongation,
        mass: PETSc.Mat,
        solve: Callable[[Array], Array],
        t: float,
        dt: float,
    ) -> None:
        """Find the effects of unit impulses. Collective.

        Raises:
            SceneError: On every rank, if the function of a motor cannot be used.
        """
        self._linkage, self._comm = linkage, prolongation.comm
        ports = Ports(prolongation, linkage)
        self._E = ports.entries
        self._D = linkage.test() @ ports.lead(prolongation.increments)
        Y = parted(mass, self._E).responses(solve)
        self._by_impulses = Y @ self._D.T
        resisted = self._D @ self._sum((self._E.T @ Y).toarray()) @ self._D.T
        speeds = together(prolongation.comm, "A motor", lambda: linkage.drives.speeds(t, dt))
        self._wanted = np.r_[np.zeros(resisted.shape[0] - speeds.size), speeds]
        self._inverse = np.linalg.pinv(resisted, hermitian=True)

    def _sum(self, values: Array) -> Array:
        values = np.ascontiguousarray(values)
        self._comm.Allreduce(MPI.IN_PLACE, values)
        return values

    def impulses(self, y: Array, fixed: Array, driven: bool) -> Array:
        """Λ by velocities y that close the joints, one per row [N s, N m s]. Collective.

        Supports give velocities of nodes, zero elsewhere [m/s]; motors rest if they are not driven.
        """
        rates = self._D @ self._sum(self._E.T @ y) + self._linkage.rates(fixed)
        if driven:
            rates -= self._wanted
        return np.asarray(-self._inverse @ rates)

    def correction(self, impulses: Array) -> Array:
        """Addition by impulses to velocities of this rank's unknowns [m/s]."""
        return np.asarray(self._by_impulses @ impulses)

    def work(self, impulses: Array, fixed: Array) -> float:
        """Work of impulses while motors have their speeds and supports theirs [J]. Collective."""
        return float(impulses @ (self._wanted - self._linkage.rates(fixed)))


def warn_of_jumps(
    scene: Scene, linkage: Linkage | None, t: float, started: Sequence[Motor]
) -> None:
    """Warn of motors that begin with another angle or travel than their joint has. Collective."""
    if linkage is None:
        return
    drives = linkage.drives
    for found in together(scene.comm, "A motor", lambda: drives.apart(t, started)):
        warn(scene.comm, f"{found}: it is thrown there in one step. Let both be the same.")


def check_stops(linkage: Linkage | None) -> None:
    """Refuse stops that would throw a joint back from beyond a limit.

    Raises:
        SceneError: On every rank, if a joint is there.
    """
    if linkage is not None and (found := linkage.drives.beyond()):
        raise SceneError(
            f"{found[0]} at the start, where the stop would throw it back. Angles and travels "
            "count from the places of the mesh: give limits around the place of the start, or "
            "start from `rf.static`, whose springs are in balance."
        )


def implied_rows(titles: Sequence[str]) -> str:
    """A warning of rows of joints that others imply, by joint and direction."""
    return (
        f"{len(titles)} of the rows of joints follow from others and are left out: "
        f"{'; '.join(titles)}. The motion is the same; how forces are shared among the joints that "
        "hold the same is not determined."
    )
