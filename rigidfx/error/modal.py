"""The error motion by modes, with the static response of all others.

    e = Φ η + (K⁻¹ - Φ Ω⁻² Φᵀ) r ,     η̈ + diag(ΦᵀCΦ) η̇ + Ω² η = Φᵀ r

(mode acceleration: R. R. Craig, Structural Dynamics, Wiley 1981, Section 15.4). Where supports
began while e was not zero it has a constant part, the static response to its values there. The
modes are those of the shape, once; a step costs the products with them. At points, and in
reactions, the static response needs no solve: with c = K⁻¹ p of the weights p of a sum, found once,
it is c·r.

The correction follows r without inertia. Where r changes slowly beside the first mode that is left
out this is exact to (ω/ω_out)². Where r jumps once, as at a switch, the modes left out swing about
it, and e is off by no more than the correction itself. Only where r goes on changing so fast is e
not known well: the measure is its mean rate, over the largest r and the last mode's ω
(`Modes.quasistatic`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.base.remembered import ON_NODES, SAME, Items, Remembered, same
from rigidfx.base.types import Array, Ints
from rigidfx.error.linear_motion import LinearMotion
from rigidfx.error.loose import Loose
from rigidfx.error.response import FACTORING, PREPARING
from rigidfx.scene.scene import Scene
from rigidfx.step.linear.definite import solver_of
from rigidfx.step.linear.eigenpairs import lowest

__all__ = ["Modal", "Modes"]


@dataclass(frozen=True)
class Modes:
    """Settings of a solution by modes.

    Attributes:
        count: Number of modes, at least: 12 to 24 told a tip's error to 6 % in bars of 7000 to
            61 000 unknowns.
        quasistatic: Mean |ṙ| over the largest |r| and the last mode's ω, up to which the static
            response of r is taken to be right: so in recordings up to 0.23, wrong from 0.66 on. The
            mean is over so long a time that one jump of r makes half of this.
    """

    count: int = 24
    quasistatic: float = 0.23


class Modal:
    """e by some modes and a static correction; `destroy` frees the factor of K."""

    remembered: ClassVar[Remembered] = {
        "at_nodes": ON_NODES,
        "_changed": Items(ON_NODES, SAME),
    } | same("_eta", "_rate", "_loads", "_change", "_level", "_since", "_squares", "_viscous")

    def __init__(
        self,
        scene: Scene,
        motion: LinearMotion,
        supported: Ints,
        loose: Loose,
        sums: Sequence[csr_array],
        e: Array,
        rate: Array,
        modes: Modes | None = None,
    ) -> None:
        """Find the modes, and the response of the sums. Collective.

        Args:
            scene: The problem.
            motion: The equations of all rows, which are freed.
            supported: Rows of this rank that supports hold.
            loose: Rigid motions that nothing holds.
            sums: Sums of e that will be asked for.
            e: At the start, shape (nodes, 3) [m].
            rate: Its rate, likewise [m/s].
            modes: The settings.
        """
        self._scene, self._modes = scene, Modes() if modes is None else modes
        (K, M, C), scale = motion.matrices, motion.scale
        first, size = K.getOwnershipRange()[0], K.getLocalSize()[0]
        self._fixed, load = _led(K, e, supported)  # constant part of e, by its supports
        self._free = np.setdiff1d(np.arange(size), supported)
        rows = PETSc.IS().createGeneral((first + self._free).astype(PETSc.IntType), comm=K.comm)
        Kf, Mf = (A.createSubMatrix(rows, rows) for A in (K, M))
        motions = [Kf.createVecRight() for _ in range(loose.count)]
        for k, vector in enumerate(motions):
            vector.array[:] = loose.motions[self._free, k]
        with PREPARING:
            pairs = lowest(Kf, Mf, self._modes.count, motions)
        self._loose = loose
        # K has an inverse but for these motions, and is definite: a preload may press it.
        self._bound = pairs.rigid == loose.count and bool((pairs.values > 0).all())
        self._squares, vectors = pairs.values, pairs.vectors
        self._phi: Array = np.array([v.array_r for v in vectors]).reshape(-1, self._free.size)
        Cf = None if C is None else C.createSubMatrix(rows, rows)
        self._m_phi: Array = np.array([_times(Mf, v) for v in vectors]).reshape(self._phi.shape)
        products = np.zeros_like(self._phi) if Cf is None else [_times(Cf, v) for v in vectors]
        self._viscous = self._summed((self._phi * products).sum(axis=1))
        for item in (pairs, Mf, rows, Cf, motion, *motions):
            if item is not None:
                item.destroy()
        self._right, self._found = Kf.createVecs()
        self._pins = np.searchsorted(self._free, loose.pins())
        Kf.zeroRowsColumns(
            (Kf.getOwnershipRange()[0] + self._pins).astype(PETSc.IntType), diag=scale
        )
        with FACTORING:
            self._solver = solver_of(Kf)
        self._n = size // 3
        if load is not None:
            self._fixed[self._free] = -self._solved(load[self._free])
        both = np.stack([e.reshape(-1) - self._fixed, rate.reshape(-1)])[:, self._free]
        self._eta, self._rate = self._summed(both @ self._m_phi.T)
        self._force: Array = np.zeros(self._free.size)  # in the last step
        self._loads: Array = np.zeros(self._squares.size)  # Φᵀ of it
        self._change = self._level = 0.0  # mean of |ṙ|, and the largest |r| so far
        self._still: tuple[Array, Array] = self._force, self._force  # a force, and K⁻¹ of it
        self._asked: Array = self._free_part()  # e when its change was asked for last ...
        self._since = 0.0  # ... the time since then [s], and what it was
        self._changed: tuple[Array, float] = np.zeros((self._n, 3)), 1.0
        self._given = sums
        self._sums = {id(own): self._adjoint(own) for own in sums}

    @property
    def at_nodes(self) -> Array:
        """Modes, M times them, last force, e that was asked for last, constant part, at the nodes.

        Shape (nodes, 3, 2 modes + 3). Whoever sets them sets a solution that goes on.
        """
        rows = *self._phi, *self._m_phi, self._force, self._asked
        fixed = self._fixed.reshape(-1, 3)
        return np.stack([*(self._field(row) for row in rows), fixed], axis=2)

    @at_nodes.setter
    def at_nodes(self, values: Array) -> None:
        every = values.reshape(3 * self._n, -1)
        self._fixed, rows = every[:, -1].copy(), every[self._free, :-1].T.copy()
        modes = (len(rows) - 2) // 2
        self._phi, self._m_phi = rows[:modes], rows[modes : 2 * modes]
        self._force, self._asked = rows[-2].copy(), rows[-1].copy()
        nothing = np.zeros_like(self._force)
        self._still = nothing, nothing
        self._sums = {id(own): self._adjoint(own) for own in self._given}

    # What is told -------------------------------------------------------------------------------

    @property
    def moving(self) -> bool:
        """Whether amplitudes, their rates or the constant part are not zero."""
        return bool(self._eta.any() or self._rate.any() or self._fixed.any())

    @property
    def valid(self) -> bool:
        """Whether K is definite."""
        return self._bound

    @property
    def hurried(self) -> bool:
        """Whether r changes as fast as modes that are left out."""
        return bool(self._change > self._slow * self._level)

    @property
    def _slow(self) -> float:
        """Rate of r over r, up to which its static response is taken to be right [1/s]."""
        return float(self._modes.quasistatic * np.sqrt(self._squares[-1]))

    def fields(self) -> tuple[Array, Array]:
        """e and ė at the owned nodes, shape (nodes, 3) each, by one solve a step. Collective."""
        e = self._field(self._free_part()) + self._fixed.reshape(-1, 3)
        return e, self._field(self._rate @ self._phi)

    def _free_part(self) -> Array:
        """Free components of e. Collective."""
        if self._still[0] is not self._force:
            self._still = self._force, self._solved(self._force)
        return np.asarray(self._still[1] + self._amplitudes() @ self._phi)

    def coarse(self) -> Array:
        """The modes and the constant part, shape (nodes, 3) [m]."""
        return self._field(self._eta @ self._phi) + self._fixed.reshape(-1, 3)

    def _field(self, free: Array) -> Array:
        """Vectors at the nodes, shape (nodes, 3), by their free components."""
        out = np.zeros(3 * self._n)
        out[self._free] = free
        return out.reshape(-1, 3)

    def at(self, sums: Sequence[csr_array]) -> tuple[Array, Array]:
        """This rank's part of sums that were given at the start."""
        e, rate = np.zeros((2, len(sums), 3))
        amplitudes = self._amplitudes()
        for k, own in enumerate(sums):
            at_modes, responses = self._sums[id(own)]
            e[k] = amplitudes @ at_modes + responses @ self._force + own @ self._fixed
            rate[k] = self._rate @ at_modes
        return e, rate

    def _amplitudes(self) -> Array:
        """η less the part of the modes in the static response of r."""
        return np.asarray(self._eta - self._loads / self._squares)

    # What changes -------------------------------------------------------------------------------

    def kick(self, change: Array) -> None:
        """Add to ė; the part of modes left out is lost. Collective."""
        self._rate = self._rate + self._summed(self._m_phi @ change.reshape(-1)[self._free])

    def step(self, force: Array, dt: float, drag: float, xi: float) -> None:
        """Step each mode by the midpoint rule. Collective."""
        r = force.reshape(-1)[self._free]
        self._note(r, dt)
        self._since += dt
        self._force, self._loads = r, self._summed(self._phi @ r)
        squares = self._squares
        damping = drag + self._viscous + xi * dt * squares
        stiff = 2 / dt**2 + damping / dt + 0.5 * squares
        d = (self._loads + 2 / dt * self._rate - squares * self._eta) / stiff
        self._eta, self._rate = self._eta + d, 2 / dt * d - self._rate

    def change(self) -> tuple[Array, float]:
        """Change of e since it was asked for last [m], and its time [s], by a solve. Collective."""
        if self._since > 0:
            now = self._free_part()
            self._changed = self._field(now - self._asked), self._since
            self._asked, self._since = now, 0.0
        return self._changed

    def scale(self, part: Array) -> None:
        """Scale all by the largest factor. Collective."""
        largest = self._scene.comm.allreduce(float(part.max(initial=0.0)), op=MPI.MAX)
        self._eta, self._rate = largest * self._eta, largest * self._rate
        self._fixed = largest * self._fixed

    def kept(self) -> object:
        """Amplitudes, forces and averages."""
        averages = self._change, self._level
        asked = self._asked, self._since, self._changed
        return self._eta, self._rate, self._force, self._loads, averages, asked

    def restore(self, kept: Any) -> None:
        """Take amplitudes, forces and averages back."""
        self._eta, self._rate, self._force, self._loads, averages, asked = kept
        self._change, self._level = averages
        self._asked, self._since, self._changed = asked

    def _note(self, r: Array, dt: float) -> None:
        """Average how fast r changes. Collective."""
        change = (r - self._force) / dt
        rate, size = np.sqrt(self._scene.sum([float(change @ change), float(r @ r)]))
        if size == 0.0:  # nothing is rigid: no solve
            self._still = r, np.zeros_like(r)
        keep = np.exp(-0.5 * self._slow * dt) if self._bound else 0.0
        self._change = float(keep * self._change + (1 - keep) * rate)
        self._level = max(self._level, float(size))

    # Helpers ------------------------------------------------------------------------------------

    def _summed(self, values: Array) -> Array:
        return np.asarray(self._scene.sum(values))

    def _solved(self, force: Array) -> Array:
        """K⁻¹ of a force at the free rows, without loose motions. Collective."""
        if self._loose.count:
            force = self._loose.balanced(self._field(force)).reshape(-1)[self._free]
            force[self._pins] = 0.0
        self._right.array[:] = force
        self._solver.solve(self._right, self._found)
        found = self._found.array_r.copy()
        if self._loose.count:
            found = self._loose.still(self._field(found)).reshape(-1)[self._free]
        return found

    def _adjoint(self, own: csr_array) -> tuple[Array, Array]:
        """Sums of Φ, shape (modes, 3), of this rank; K⁻¹ of their weights p, shape (3, free rows).

        Collective.
        """
        weights = own.toarray()[:, self._free]
        return self._phi @ weights.T, np.array([self._solved(row) for row in weights])

    def destroy(self) -> None:
        """Free the solver and its vectors. Collective."""
        for item in (self._solver, self._right, self._found):
            item.destroy()


def _times(A: PETSc.Mat, v: PETSc.Vec) -> Array:
    """This rank's part of A v. Collective."""
    out = A.createVecLeft()
    A.mult(v, out)
    values: Array = out.array_r.copy()
    out.destroy()
    return values


def _led(K: PETSc.Mat, e: Array, supported: Ints) -> tuple[Array, Array | None]:
    """e at supports, zero elsewhere, shape (dofs,), and K times it; None if zero. Collective."""
    led = K.createVecRight()
    led.array[supported] = e.reshape(-1)[supported]
    load = _times(K, led) if led.norm() > 0 else None
    values: Array = led.array_r.copy()
    led.destroy()
    return values, load
