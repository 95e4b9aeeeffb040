"""Which dofs the supports hold at a time, how they move, and the impact where a support begins.

A support that begins on a moving node, or a prescribed motion that jumps in velocity, is an
impact: the update of the velocity would otherwise ring for ever. The velocity is projected, in the
metric of the mass, on those that the support allows; energy and impulse of the impact are reported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from petsc4py import PETSc

from rigidfx.base.errors import SceneError, together
from rigidfx.base.matrices import free
from rigidfx.base.types import Array, Indices, Ints
from rigidfx.coupling.dof_layout import DofLayout
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects import Support, Windowed
from rigidfx.linear.linear_solver import BRIEF, conjugate_gradients, solver_of
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rotation import axial
from rigidfx.scene.scene import Scene
from rigidfx.state import State


@dataclass(frozen=True)
class Impact:
    """Velocity taken over from a support at an instant; or energy of a contact that begins or ends.

    Attributes:
        t: Time [s].
        supports: Names of the supports that caused it, titles of the contacts.
        energy: Change of kinetic energy, and of the energy of bodies that a support takes over, and
            of contacts [J]; negative is lost.
        impulse: Impulse exerted on the structure, shape (3,) [N s].
        angular_impulse: Its moment about the origin, shape (3,) [N m s].
        following: Kinetic energy of the parts on these supports, had they followed the change of
            velocity as rigid bodies [J].
    """

    t: float
    supports: tuple[str, ...]
    energy: float
    impulse: Array
    angular_impulse: Array
    following: float

    def __add__(self, other: Impact) -> Impact:
        return Impact(
            self.t,
            (*self.supports, *other.supports),
            self.energy + other.energy,
            self.impulse + other.impulse,
            self.angular_impulse + other.angular_impulse,
            self.following + other.following,
        )


class PrescribedDofs:
    """The dofs held by the supports that act at one time.

    Attributes:
        active: The supports.
        mask: For each owned dof, whether it is prescribed, shape (3 · owned nodes,).
    """

    def __init__(
        self,
        scene: Scene,
        active: tuple[Support, ...],
        driven: Mapping[int, Indices] | None = None,
        without: Indices | None = None,
    ) -> None:
        """Find the dofs of supports that act, and of further nodes that these move.

        Owned nodes `without` dofs of their own are those of bodies whose frames supports hold.
        """
        self._scene = scene
        self.active = active
        owner = np.full(3 * scene.owned_nodes, -1, dtype=np.int32)
        for k, support in reversed(list(enumerate(self.active))):
            owner[dofs_of(scene, support)] = k
        for k, nodes in (driven or {}).items():
            owner[(3 * nodes[:, None] + np.arange(3)).reshape(-1)] = k
        if without is not None:
            owner[(3 * without[:, None] + np.arange(3)).reshape(-1)] = -1
        self.mask = owner >= 0
        self._owner = owner[self.mask]
        held = np.flatnonzero(self.mask)
        self._axis = (held % 3).astype(np.int32)
        self._nodes = held // 3
        self._X = scene.space.tabulate_dof_coordinates()[self._nodes]
        self._own = [np.flatnonzero(self._owner == k) for k in range(len(self.active))]
        self._paths: dict[int, dict[float, Array]] = {}  # of each support, where last asked for

    def of_each(self) -> list[tuple[str, Ints]]:
        """Each support's set, and the owned dofs that it holds."""
        held = np.flatnonzero(self.mask)
        return [(s.where, held[own]) for s, own in zip(self.active, self._own, strict=True)]

    @property
    def moves(self) -> bool:
        """Whether the motion of a support is a function of time."""
        return any(support.moves for support in self.active)

    def increments(self, t0: float, t1: float, u: Array) -> Array:
        """Increments of held dofs from t0 to t1 [s, m], at local displacements u. Collective."""

        def gained(support: Support, X: Array, x: Array) -> Array:
            if not support.uniform:
                return support.increments_of(t0, t1, X, x)
            u0, u1 = self._path(support, t0), self._path(support, t1)
            for given in (u0, u1):
                if given.shape != (3,):
                    return given  # which is an error below
            return np.asarray(u1 - u0)

        return self._ask(gained, t1, u)

    def path_at(self, support: Support, t: float) -> Array:
        """See `Support.path_at`; a path that all nodes share is kept from the last step."""
        if not support.uniform:
            return support.path_at(t)
        return np.asarray(self._path(support, t)[list(support.axes)])

    def _path(self, support: Support, t: float) -> Array:
        """Displacement of all nodes of a support at t, kept for the next question [m]."""
        known = self._paths.get(id(support), {})
        if t not in known:
            # A path may change one array in place.
            value = np.array(support.displacements_at(t, support.points))
            known = dict([*known.items(), (t, value)][-3:])
            self._paths[id(support)] = known
        return known[t]

    def velocities(self, t: float, dt: float, u: Array) -> Array:
        """Velocities of the held dofs just after t [s, m/s], at local displacements u. Collective.

        Δt is the scale of difference quotients.
        """
        return self._ask(lambda support, X, x: support.velocities_at(t, dt, X, x), t, u)

    def _ask(self, question: Callable[[Support, Array, Array], Array], t: float, u: Array) -> Array:
        """Answers of each support, spread over its dofs; a user's function that fails is an error.

        The question is a function of a support, and of reference positions and places of its dofs'
        nodes, shape (dofs, 3) [m], to a vector for each of them, or one for all. Collective.
        """

        def answers() -> list[Array]:
            out = []
            for support, own in zip(self.active, self._own, strict=True):
                X = self._X[own]
                x = X + u.reshape(-1, 3)[self._nodes[own]]
                name = f"{type(support).__name__} on '{support.where}'"
                try:
                    value = question(support, X, x)
                except Exception as error:  # whatever a user's function may raise
                    raise SceneError(
                        f"{name}: its path failed near t = {t:g} s with "
                        f"{type(error).__name__}: {error}"
                    ) from error
                if np.shape(value) not in ((3,), X.shape) or not np.isfinite(value).all():
                    raise SceneError(
                        f"{name}: near t = {t:g} s its path or velocity is not three finite "
                        f"numbers but {value}."
                    )
                out.append(value)
            return out

        every = together(self._scene.comm, "A support", answers) if self.moves else answers()
        spread = np.zeros(self._owner.size)
        for own, values in zip(self._own, every, strict=True):
            each = np.broadcast_to(values, (own.size, 3))
            spread[own] = each[np.arange(own.size), self._axis[own]]
        return spread

    def reactions(self, forces: Array, x: Array) -> tuple[dict[str, Array], dict[str, Array]]:
        """Force and moment [N, N m] of each support on the structure, by its set, (3,). Collective.

        Held dofs have out-of-balance forces [N]; their nodes are at x, shape (dofs, 3) [m].
        """
        sums = np.zeros((len(self.active), 6))
        for total, own in zip(sums, self._own, strict=True):
            f = np.zeros((own.size, 3))
            f[np.arange(own.size), self._axis[own]] = forces[own]
            total[:3], total[3:] = f.sum(axis=0), axial(x[own].T @ f)
        out: dict[str, Array] = {}
        for support, total in zip(self.active, np.asarray(self._scene.sum(sums)), strict=True):
            out[support.where] = out.get(support.where, 0.0) + total
        return {k: v[:3] for k, v in out.items()}, {k: v[3:] for k, v in out.items()}


class ReducedMass:
    """Lᵀ M L + the bodies' own where the bodies were at first; made when it is needed first.

    Attributes:
        p: Map between unknowns and dofs.
        mass: The mass of nodes, M.
    """

    def __init__(self, p: Prolongation, mass: Mass, bodies: Bodies) -> None:
        self.p, self.mass, self._bodies = p, mass, bodies
        self._matrix: PETSc.Mat | None = None
        self._factors: PETSc.KSP | None = None
        self._r, self._y = p.unknowns(), p.unknowns()

    @property
    def matrix(self) -> PETSc.Mat:
        """It [kg]. Collective."""
        if self._matrix is None:
            now = self.p.increments
            self.p.pose(self._bodies)
            self._matrix = self.mass.reduced(self.p, self._bodies.led_mass_blocks)
            self.p.increments = now
        return self._matrix

    def solve(self, momenta: Array) -> Array:
        """Velocities of this rank's unknowns by their momenta. Collective.

        Each step of a support that moves solves: kept factors take less time where they are small.
        """
        self._r.array[:] = momenta
        self._y.set(0.0)
        if self._r.norm() > 0.0 and self.p.size > BRIEF:
            conjugate_gradients(self.matrix, self._r, self._y)
        elif self._r.norm() > 0.0:
            self._factors = self._factors or solver_of(self.matrix.copy())
            self._factors.solve(self._r, self._y)
        return self._y.array_r.copy()

    def followed(self, w: PETSc.Vec, momenta: PETSc.Vec) -> Array:
        """Velocities of bodies, shape (bodies, 6 + m), by impulses on held rows [m/s]. Collective.

        The vector w has given velocities of the held rows, zero elsewhere, and those of all rows
        afterwards; momenta M w are overwritten.
        """
        p = self.p
        given = w.array_r[p.prescribed].copy()
        self.mass.mult(w, momenta)
        p.restrict(momenta, p.no_bodies, self._r)
        if self._r.norm() == 0.0:  # no mass couples held rows to others
            return p.no_bodies
        self.solve(-self._r.array_r)
        of_bodies = p.bodies_part(self._y)
        p.apply(self._y, of_bodies, given, w)
        self.mass.mult(w, momenta)
        return of_bodies

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        free(self._matrix, self._factors, self._r, self._y)


def supports_of(acting: Sequence[Windowed]) -> tuple[Support, ...]:
    """The supports among the effects that act."""
    every: Sequence[Any] = acting
    return tuple(effect for effect in every if effect.is_support)


def dofs_of(scene: Scene, support: Support) -> Ints:
    """Owned dofs that a support holds while it acts."""
    nodes = next(nodes for s, nodes in scene.supports if s is support)
    owned = nodes[nodes < scene.owned_nodes].astype(np.int64)
    return (3 * owned[:, None] + np.asarray(support.axes)).reshape(-1)


def impose_velocity(
    scene: Scene, state: State, mass: Mass, layout: DofLayout, velocities: Array
) -> tuple[Ints, Array] | None:
    """Give the held dofs their prescribed velocities [m/s], by an impact without rebound.

    The impulse acts on held dofs only, so the momentum of all others stays: with Δv_s given, (Lᵀ M
    L + bodies) Δy = -Lᵀ M Δv_s. For a lumped mass no other velocity changes.

    The held dofs and the changes of their velocity are returned; None if none changed on any rank.
    Collective.
    """
    rows = layout.rows
    prescribed = np.flatnonzero(layout.prescribed[rows.dofs])
    dv, p = rows.vector(), rows.vector()
    dv.set(0.0)
    jump = velocities - state.v.x.array[rows.dofs[prescribed]]
    dv.array[prescribed] = jump
    changed = dv.norm(PETSc.NormType.INFINITY) > 0.0
    if changed:
        prolongation, bodies = Prolongation(layout, scene.comm), state.bodies
        prolongation.pose(bodies)
        reduced = ReducedMass(prolongation, mass, bodies)
        gained = reduced.followed(dv, p)
        if gained.any():
            bodies = bodies.with_rates(bodies.rates + gained)
        state.kick(rows.dofs, dv.array_r, bodies)
        reduced.destroy()
    free(dv, p)
    return (rows.dofs[prescribed].astype(np.int64), jump) if changed else None
