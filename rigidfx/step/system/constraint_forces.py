"""Forces of joints and supports without the part that alternates from step to step.

docs/theory/joints.md#forces-that-do-not-alternate has λ*, by the mass or, with `ResolvedForces`, by
the tangent of the step. No other step is needed, so that nothing is smeared over switches, impacts,
or ends of windows. The motion, its work and its energy are those of λ.

The rate of a path is that of the parabola through its values at start, middle and end of a step,
that at the start the one at the end of the step before: a kink between two steps counts in the
later one. K (v₁ - v₀) is the change of the cells' forces by v₁ at the end and -v₀ at the start, in
which a rigid rotation strains nothing. Dampers of ratio ζ add an error of 2 ζ² ωΔt of inertial
forces. Stiffnesses of contacts and springs are in A only.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cache

import numpy as np
from mpi4py import MPI

from rigidfx.base.matrices import dense, free
from rigidfx.base.types import Array
from rigidfx.effects.joints.elements import end_rates
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.effects.nodes import Forces
from rigidfx.linear.linear_solver import configure
from rigidfx.mechanics.body_step import Increments
from rigidfx.mechanics.rotation import orthonormalized
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.equations import Equations
from rigidfx.step.equations.supports import ReducedMass
from rigidfx.step.newton.border import BorderedFactors, parted

# Finds additions to multipliers of joints [N], and forces of these on vectors, shape (vectors, 3).
Added = Callable[[], tuple[Array, Array]]


class AddedForces(ABC):
    """λ* - λ of the supports and joints of a division; `destroy` frees its vectors."""

    def __init__(self, equations: Equations) -> None:
        """Keep the equations of steps. Collective."""
        self._equations, self._prescribed = equations, equations.prescribed
        self._p, self._linkage = equations.prolongation, equations.linkage
        rows = self._p.layout.rows
        self._held = rows.dofs[self._p.prescribed]
        self._last: Array = np.empty(0)  # rates of paths at the end of a step [m/s]
        self._f, self._w = rows.vector(), rows.vector()

    @abstractmethod
    def find(self, state: State) -> tuple[Array, Added | None]:
        """λ* - λ of the step that has been solved from a state. Collective.

        Forces on held rows [N], and those of joints; None without joints.
        """

    def _gained(self, state: State) -> Array:
        """Change of rates of paths in the step that has been solved [m/s]. Collective."""
        dt, d = self._equations.dt, self._equations.d.array_r[self._p.prescribed]
        times = state.t, state.t + 0.5 * dt
        middle = self._prescribed.increments(*times, state.u.x.array)
        first, self._last = end_rates(np.zeros(d.size), d, middle, dt)
        if state.path_rates is not None:
            known = state.path_rates[self._held]
            first = np.where(np.isnan(known), first, known)
        return np.asarray(self._last - first)

    def _off(self, linkage: Linkage, v0: Array, v1: Array) -> Callable[[], Array]:
        """Finds the change of velocities across rows of joints in the step [m/s]. Collective.

        Rows of nodes have velocities v₀ at its start and v₁ at its end; motors prescribe a change
        of rates. Of rows with compliance it is zero.
        """
        increments = self._equations.prolongation.increments
        ends = (v0, increments.start), (v1, increments.end)
        start, end = (linkage.averages.velocities(*given) for given in ends)
        given = linkage.drives.given

        def off() -> Array:
            out = linkage.across(1.0, end) - linkage.across(0.0, start)
            out[linkage.rows.active.size :] += given
            return np.where(linkage.compliance() == 0.0, out, 0.0)

        return off

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
        free(self._f, self._w)


class MeanConstraints(AddedForces):
    """λ* - λ by the mass alone; `destroy` frees it."""

    def __init__(self, equations: Equations) -> None:
        """Reduce the mass, and find its inverse at the ports of joints. Collective."""
        super().__init__(equations)
        bodies, joints, p = equations.structure.bodies, equations.constraints, self._p
        self._reduced = reduced = ReducedMass(p, equations.mass, bodies)
        if joints is None:
            return
        self._ports = ports = joints.ports
        self._R = bodies.R[ports.bodies]
        Y = parted(reduced.matrix, ports.entries).responses(reduced.solve)
        self._C = p.sum((ports.entries.T @ Y).toarray())
        held = np.isin(joints.linkage.averages.rows, p.prescribed // 3).any()
        self._on_supports: bool = p.comm.allreduce(bool(held), op=MPI.LOR)

    def find(self, state: State) -> tuple[Array, Added | None]:
        """See `AddedForces`."""
        equations, at = self._equations, self._p.prescribed
        dt, d, v0 = equations.dt, equations.d.array_r, equations.trial.v0.array_r
        v1 = 2 / dt * d - v0
        more: Array = np.zeros(at.size)
        if self._prescribed.moves:
            self._w.set(0.0)
            self._w.array[at] = (v1 - v0)[at] - self._gained(state)
            self._reduced.followed(self._w, self._f)
            more = -self._f.array_r[at] / dt
            v1 = v1 - self._w.array_r
        if self._linkage is None:
            return more, None
        added = self._of_joints(self._linkage.kept(), v0, v1, dt)
        if self._on_supports:
            more = more + self._on_nodes(added()[1])[at]
        return more, added

    def _of_joints(self, linkage: Linkage, v0: Array, v1: Array, dt: float) -> Added:
        """λ* - λ of joints; v₁ is without the change of w of supports. Collective."""
        increments, off = self._p.increments, self._off(linkage, v0, v1)

        @cache
        def added() -> tuple[Array, Array]:
            more, bound = np.zeros(linkage.count), linkage.compliance() == 0.0
            D = dense(linkage.test() @ self._ports.lead(increments))[bound]
            more[bound] = _inverse(D @ self._turned(increments) @ D.T) @ off()[bound] / dt
            return more, linkage.on_vectors(more)

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

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._reduced.destroy()
        super().destroy()


# Strain by which forces are differentiated: rounding, and products of velocities, leave as much of
# K v as this is of the strain of one cell that moves alone.
STRAIN = float(np.cbrt(np.finfo(np.float64).eps))


class ResolvedConstraints(AddedForces):
    """λ* - λ by the tangent of a step; `destroy` frees its solver.

    Numbers that are reported must not depend on when Newton's method renews its own tangent: that
    is another matter on other numbers of ranks, and in resumed runs.
    """

    def __init__(self, equations: Equations, scene: Scene) -> None:
        """Make a solver. Collective."""
        super().__init__(equations)
        p = self._p
        self._factors, self._tangent = BorderedFactors(equations), equations.new_tangent()
        configure(self._factors.inner, True, p.size, len(p.layout.bodies) > 0)
        self._mass, self._cell, self._comm = equations.mass, scene.mean_cell_size, p.comm
        self._strains = self._any(sum(own.size for own in p.layout.flexible.values()))
        self._holds = self._any(p.prescribed.size)
        self._r, self._z = equations.unknowns(), equations.unknowns()

    def _any(self, count: int) -> bool:
        return bool(self._comm.allreduce(count) > 0)

    def find(self, state: State) -> tuple[Array, Added | None]:
        """See `AddedForces`."""
        equations, p, dt = self._equations, self._p, self._equations.dt
        d, v0 = equations.d.array_r, equations.trial.v0.array_r.copy()
        at, v1 = p.prescribed, 2 / dt * d - v0
        across = np.zeros(d.size)
        across[at] = v1[at] - v0[at]
        if self._prescribed.moves:
            across[at] -= self._gained(state)
        v1 -= across
        if p.attached.size:
            v0[p.attached] = p.rates(p.increments.start)
            v1[p.attached] = p.rates(p.increments.end)
        linkage = self._linkage
        off = np.zeros(0) if linkage is None else self._off(linkage, v0, v1)()
        equations.tangent(self._tangent)
        self._factors.renew(self._tangent.matrix)
        f = self._change(state, -v0, v1) - 2 / dt**2 * self._momenta(across)
        of_bodies, w, _ = self._respond(f, p.no_bodies, off, across[at])
        blocks = p.increments.start.led_mass_blocks
        own = 2 / dt**2 * (blocks @ of_bodies[:, :, None])[:, :, 0]
        momenta = self._momenta(w)
        nothing = np.zeros(at.size)
        _, lasting, μ = self._respond(2 / dt**2 * momenta, own, 0.0 * off, nothing)
        held: Array = np.asarray((self._momenta(lasting) - momenta)[at] / dt, np.float64)
        if self._holds:
            held += dt / 4 * self._change(state, lasting, lasting)[at]
        if linkage is None:
            return held, None
        more = 0.5 * dt * μ
        on_vectors = linkage.on_vectors(more)
        if self._holds:
            held += self._on_nodes(on_vectors)[at]
        return held, lambda: (more, on_vectors)

    def _change(self, state: State, at_start: Array, at_end: Array) -> Array:
        """Derivative of the cells' forces along displacements of both ends of the step [N/m]."""
        size = max(np.abs(at_start).max(initial=0.0), np.abs(at_end).max(initial=0.0))
        size = self._comm.allreduce(float(size), op=MPI.MAX) if self._strains else 0.0
        none = np.zeros(at_start.size)
        if size == 0.0:
            return none
        share = STRAIN * self._cell / size
        before, dofs = state.snapshot(), self._p.layout.rows.dofs
        state.shift(dofs, share * at_start)
        forces = self._equations.cells_at(share * at_start, share * at_end)
        state.restore(before)
        return np.asarray((forces - self._equations.cells_at(none, none)) / share)

    def _momenta(self, v: Array) -> Array:
        """M v of the rows."""
        self._w.array[:] = v
        self._mass.mult(self._w, self._f)
        return self._f.array_r.copy()

    def _respond(
        self, f: Array, bodies: Array, off: Array, held: Array
    ) -> tuple[Array, Array, Array]:
        """Response of bodies, rows and multipliers of joints to forces; `held` is given."""
        p, joints = self._p, self._equations.constraints
        self._f.array[:] = f
        p.restrict(self._f, bodies, self._r)
        if joints is not None:
            joints.fill(off, self._r.array)
        self._factors.apply(None, self._r, self._z)
        of_bodies = p.bodies_part(self._z)
        p.apply(self._z, of_bodies, held, self._w)
        μ = np.empty(0) if joints is None else joints.multipliers(self._z.array_r)
        return of_bodies, self._w.array_r.copy(), μ

    def destroy(self) -> None:
        """Free the solver and the vectors. Collective."""
        free(self._factors, self._tangent, self._r, self._z)
        super().destroy()


def _inverse(S: Array) -> Array:
    """A pseudo-inverse, as rows of a nearly singular pose have no force of their own."""
    own = np.sqrt(np.diagonal(S))
    own = np.divide(1.0, own, out=np.zeros_like(own), where=own > 0)
    least = np.finfo(np.float64).eps ** (2 / 3)
    inverse = np.linalg.pinv(own[:, None] * S * own, rcond=least, hermitian=True)
    return np.asarray(own[:, None] * inverse * own)
