"""Forces of joints and supports without the part that alternates from step to step.

A step has v₁ = 2 Δx/Δt - v₀, and rows of joints and paths of supports hold at its ends. So a
velocity across them, e = G v - ṡ with the given rate ṡ, changes its sign in each step and stays for
ever. λ is right in the mean of two steps, and has ∓2 (G M⁻¹ Gᵀ)⁻¹ e/Δt in addition. The velocities
v - w, M w = Gᵀ (G M⁻¹ Gᵀ)⁻¹ e, fulfil the rows. A step between such velocities has the multipliers

    λ* = λ + (G M⁻¹ Gᵀ)⁻¹ (e₁ - e₀)/Δt,

with an error of order Δt² at its middle. They need no other step, so that nothing is smeared over
switches, impacts, or ends of windows. The motion, its work and its energy are those of λ.

The rate of a path is that of the parabola through its values at start, middle and end of a step.
ṡ₀ is that at the end of the step before, so that a kink between two steps counts in the later one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from rigidfx.base.matrices import dense
from rigidfx.base.types import Array
from rigidfx.effects.joints.elements import end_rates
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.effects.nodes import Forces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments
from rigidfx.mechanics.rotation import orthonormalized
from rigidfx.state import State
from rigidfx.step.equations.constraints import Constraints
from rigidfx.step.equations.equations import Equations
from rigidfx.step.equations.supports import ReducedMass
from rigidfx.step.newton.border import parted

# Finds additions to multipliers of joints [N], and forces of these on vectors, shape (vectors, 3).
Added = Callable[[], tuple[Array, Array]]


class JointForces:
    """λ* - λ of the joints of a division; arrays are equal on all ranks.

    It has `on_supports`, whether joints take hold of nodes that supports hold.
    """

    def __init__(self, joints: Constraints, reduced: ReducedMass, bodies: Bodies) -> None:
        """Find the inverse of the reduced mass, which is that of these bodies. Collective."""
        linkage, ports = joints.linkage, joints.ports
        self._linkage, self._ports, self._R = linkage, ports, bodies.R[ports.bodies]
        Y = parted(reduced.matrix, ports.entries).responses(reduced.solve)
        self._C = np.ascontiguousarray((ports.entries.T @ Y).toarray())
        comm = reduced.p.comm
        comm.Allreduce(MPI.IN_PLACE, self._C)
        held = np.isin(linkage.averages.rows, reduced.p.prescribed // 3).any()
        self.on_supports: bool = comm.allreduce(bool(held), op=MPI.LOR)

    def find(self, v0: Array, v1: Array, increments: Increments, dt: float) -> Added:
        """λ* - λ of the step that has been solved, as a function that finds it once. Collective.

        Rows have velocities v₀ at its start, and v₁ at its end less the change of w of supports
        [m/s]. The function gives λ* - λ of each row that has a force [N], and the forces of these
        on vectors, as a resistance, shape (vectors, 3) [N].
        """
        linkage = self._linkage.kept()
        ends = (v0, increments.start), (v1, increments.end)
        start, end = (linkage.averages.velocities(*given) for given in ends)
        given, found = linkage.drives.given, list[tuple[Array, Array]]()

        def added() -> tuple[Array, Array]:
            if not found:
                off = gained_across(linkage, start, end, given)
                more, bound = np.zeros(off.size), linkage.compliance() == 0.0
                D = dense(linkage.test() @ self._ports.lead(increments))[bound]
                more[bound] = _inverse(D @ self._turned(increments) @ D.T) @ off[bound] / dt
                found.append((more, linkage.on_vectors(more)))
            return found[0]

        return added

    def _turned(self, increments: Increments) -> Array:
        """The inverse mass in the middle of the step, as bodies have turned."""
        if not len(self._R):
            return self._C
        turned = orthonormalized(increments.R_av[self._ports.bodies]) @ self._R.swapaxes(1, 2)
        Q = np.eye(len(self._C))
        for own, ports in zip(turned, self._ports.at, strict=True):
            for at in ports[:6:3][ports[:6:3] >= 0]:  # no support holds the frame
                Q[at : at + 3, at : at + 3] = own
        return np.asarray(Q @ self._C @ Q.T)


class AddedForces(ABC):
    """λ* - λ of the supports and joints of a division; `destroy` frees its vectors."""

    def __init__(self, equations: Equations) -> None:
        """Keep the equations of steps. Collective."""
        self._equations, self._prescribed = equations, equations.prescribed
        joints, p = equations.constraints, equations.prolongation
        self._linkage, rows = None if joints is None else joints.linkage, p.layout.rows
        self._held = rows.dofs[p.prescribed]
        self._last: Array = np.empty(0)  # rates of paths at the end of a step [m/s]
        self._f, self._w = rows.vector(), rows.vector()

    @abstractmethod
    def find(self, state: State) -> tuple[Array, Added | None]:
        """λ* - λ of the step that has been solved from a state. Collective.

        Forces on held rows [N], and those of joints; None without joints.
        """

    def _gained(self, state: State) -> Array:
        """Change of rates of paths in a step that has been solved from a state [m/s].

        Collective.
        """
        equations, at = self._equations, self._equations.prolongation.prescribed
        dt, d = equations.dt, equations.d.array_r[at]
        times = state.t, state.t + 0.5 * dt
        middle = self._prescribed.increments(*times, state.u.x.array)
        first, self._last = end_rates(np.zeros(d.size), d, middle, dt)
        if state.path_rates is not None:
            known = state.path_rates[self._held]
            first = np.where(np.isnan(known), first, known)
        return np.asarray(self._last - first)

    def _on_nodes(self, on_vectors: Array) -> Array:
        """Forces on vectors as those on the rows."""
        self._f.set(0.0)
        if self._linkage is not None:
            self._linkage.resist(Forces.none(self._f), on_vectors)
        return self._f.array_r.copy()

    def accept(self, state: State) -> None:
        """Keep the rates of paths at the end of the step."""
        if self._prescribed.moves:
            state.follow_paths(self._held, self._last)

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._f.destroy()
        self._w.destroy()


class MeanConstraints(AddedForces):
    """λ* - λ by the mass alone; `destroy` frees it."""

    def __init__(self, equations: Equations) -> None:
        """Reduce the mass. Collective."""
        super().__init__(equations)
        bodies, joints = equations.structure.bodies, equations.constraints
        self._reduced = ReducedMass(equations.prolongation, equations.mass, bodies)
        self._joints = None if joints is None else JointForces(joints, self._reduced, bodies)

    def find(self, state: State) -> tuple[Array, Added | None]:
        """See `AddedForces`."""
        equations, p = self._equations, self._equations.prolongation
        dt, d, v0 = equations.dt, equations.d.array_r, equations.trial.v0.array_r
        at, v1 = p.prescribed, 2 / dt * d - v0
        more: Array = np.zeros(at.size)
        if self._prescribed.moves:
            self._w.set(0.0)
            self._w.array[at] = (v1 - v0)[at] - self._gained(state)
            self._reduced.followed(self._w, self._f)
            more = -self._f.array_r[at] / dt
            v1 = v1 - self._w.array_r
        if self._joints is None:
            return more, None
        added = self._joints.find(v0, v1, p.increments, dt)
        if self._joints.on_supports:
            more = more + self._on_nodes(added()[1])[at]
        return more, added

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._reduced.destroy()
        super().destroy()


def gained_across(linkage: Linkage, start: Array, end: Array, given: Array) -> Array:
    """Change of velocities across rows of joints in a step that has been solved [m/s].

    Averages have velocities at its start and end, shape (averages, 3), and motors prescribe a
    change of rates [m/s].
    """
    out = linkage.across(1.0, end) - linkage.across(0.0, start)
    out[linkage.rows.active.size :] += given
    return out


def _inverse(S: Array) -> Array:
    """A pseudo-inverse, as rows of a nearly singular pose have no force of their own."""
    own = np.sqrt(np.diagonal(S))
    own = np.divide(1.0, own, out=np.zeros_like(own), where=own > 0)
    least = np.finfo(np.float64).eps ** (2 / 3)
    inverse = np.linalg.pinv(own[:, None] * S * own, rcond=least, hermitian=True)
    return np.asarray(own[:, None] * inverse * own)
