"""ρ of the present bodies: the forces at their nodes that rigidity bears in place of stiffness.

In the frame of a body they are

    ρ = R̄ᵀ (f_ext - f_flexible - M (v₁ - v₀)/Δt - ½ (R₀ + R₁) f⁰) ,

the forces of loads and flexible cells, minus the inertia of the body's motion, minus the internal
forces f⁰ of the shape that the body keeps, in the form that the Energy–Momentum Method gives them
for a rotating shape, with K Φ q½ of bodies that have shapes. R̄ is the rotation halfway through the
step. The mean of both rotations is shorter: with it f⁰ would be 1 - cos(ωΔt/2) too large in a
steady spin by ωΔt per step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.coupling.mass import Mass
from rigidfx.effects import Structure, Windowed
from rigidfx.effects.motion import Forces, Motion
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments, Step
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.step.equations.actions import Actions
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt, Watch
from rigidfx.withheld.parts import Parts, watched

# What PETSc's log calls this part of a run.
_BEARING = PETSc.Log.Event("rigidfxBodyForces")


@dataclass(frozen=True)
class _Turning:
    """How bodies turn in a step: numbers of each, by which forces of inertia are linear in places.

    Attributes:
        gained: Gain of `pose_rate` over Δt [m/s², 1/s²], shape (bodies, n, 3).
        R: Rotations halfway, shape (bodies, 3, 3).
        shorter: Of their means in these frames, likewise.
    """

    gained: Array
    R: Array
    shorter: Array


class Withheld:
    """The force on the nodes of some bodies of a division; `destroy` frees its PETSc objects."""

    def __init__(self, stepper: Stepper, parts: Parts, mass: Mass, linear: LinearForms) -> None:
        """Bind the effects to the bodies' nodes. Collective.

        Args:
            stepper: Solves the steps.
            parts: The bodies.
            mass: Mass operator of the rows.
            linear: Forms, whose shape is that of the bodies.
        """
        self._stepper, self._parts, self._mass = stepper, parts, mass
        scene, forces = stepper.scene, stepper.forces
        self._forces = forces
        layout = stepper.system.layout
        numbers = [body.number for body in layout.bodies]
        self._of = [numbers.index(body.number) for body in parts.bodies]
        self._attached = []
        for k, at in zip(self._of, parts.at, strict=True):
            nodes = layout.attached[k]
            self._attached.append((at[nodes], layout.rows.positions(layout.bodies[k].nodes[nodes])))
        self._u0, self._u1 = fem.Function(scene.space), fem.Function(scene.space)
        self._b = fem.Function(scene.space)
        fem.assemble_vector(self._b.x.array, linear.force(parts.cells))
        self._b.x.scatter_reverse(la.InsertMode.add)
        self._frozen = self._b.x.array[parts.rows.dofs].reshape(-1, 3)
        self._loads = forces.bind_loads(parts.cells, self._u0, self._u1)
        self._none = none = Bodies.of_each(())
        self._structure = Structure(
            scene=scene,
            rows=parts.rows,
            own=np.ones(parts.rows.nodes.size, dtype=bool),
            bodies=none,
            mass=mass,
            u=self._u0.x.array,
            surface=forces.surface,
        )
        self._place(self._u0, stepper.state.bodies)
        self._acting: Sequence[Windowed] = stepper.system.acting
        self._actions = Actions(self._structure, scene.effects, self._acting)
        self._d, self._f, self._a = (parts.rows.vector() for _ in range(3))
        self._dead: Array | None = None  # the last ones that do not follow the bodies, and
        self._asked: tuple[float, float] | None = None  # the step that they are of
        touched = any(own.size for own, _ in self._attached)
        self._untouched = not scene.comm.allreduce(touched, op=MPI.LOR)

    def _place(self, u: fem.Function, bodies: Bodies) -> None:
        """Set the displacement of the rows where bodies are. Collective."""
        x = self._parts.linear(bodies.pose[self._of])
        x -= self._parts.rows.X
        u.x.array[self._parts.rows.dofs] = x.reshape(-1)
        u.x.scatter_forward()

    def force(self, t: float, dt: float) -> Array:
        """ρ of the step that has been solved last, in the bodies' frames. Collective.

        Args:
            t: Time at its start [s].
            dt: Its length [s].

        Returns:
            Forces on the nodes of the rows, without those that would move a body, shape (nodes, 3)
            [N].
        """
        system = self._stepper.system
        increments = system.equilibrium.prolongation.increments
        start, end = increments.start, increments.end
        if self._loads is not None or not system.dead:
            self._place(self._u0, start)
        if self._loads is not None:
            self._place(self._u1, end)
        given = self._loads_of(t, dt, system.acting)
        gained = np.asarray((end.pose_rate[self._of] - start.pose_rate[self._of]) / dt)
        W, shorter, Vt = np.linalg.svd(increments.R_av[self._of])
        turning = _Turning(gained, W @ Vt, Vt.mT * shorter[:, None] @ Vt)
        out = self._resisted(turning, increments.displacement[self._of], dt, given)
        for k, (body, at) in enumerate(zip(self._parts.bodies, self._parts.at, strict=True)):
            if body.shapes is not None and not body.shapes.images.size:
                out[at] = 0.0  # a part named `Reduced`: see ν
            elif body.shapes is not None:
                half = 0.5 * (start.q + end.q)[self._of[k], : body.deforms_by]
                out[at] -= np.einsum("nka,k->na", body.shapes.images, half)
        self._parts.balance(out)
        return out

    def _resisted(self, turning: _Turning, moved: Array, dt: float, given: Array) -> Array:
        """ρ of bodies that turn so, and are displaced by `moved` in a step. Collective."""
        system, parts, f = self._stepper.system, self._parts, self._f
        # The residual of the nodes if they were flexible, but for what their own cells do. They
        # move as a body does: what they do is linear in their places in it.
        self._d.array[:] = parts.linear(moved).reshape(-1)
        self._a.array[:] = parts.linear(turning.gained).reshape(-1)
        self._mass.mult(self._a, f)
        f.array[:] -= given
        none = Increments(Step(self._none, dt), np.empty((0, 6)))
        self._actions.resist(Motion(self._d, none, dt), Forces.none(f))
        residual = f.array.reshape(-1, 3)
        system.resist_at_nodes(parts.rows.nodes, residual)
        if not self._untouched:
            of_flexible = system.equilibrium.forces_out_of_balance.array_r.reshape(-1, 3)
            for own, active in self._attached:
                residual[own] += of_flexible[active]
        out = parts.turned(residual, -turning.R)
        out -= parts.turned(self._frozen, turning.shorter)
        return out

    def _loads_of(self, t: float, dt: float, acting: Sequence[Windowed]) -> Array:
        """Dead and follower loads in a step on all dofs of the rows [N]. Collective.

        Dead ones that have not changed are the array that they were.
        """
        if acting is not self._acting:
            self._acting = acting
            self._actions.select(acting)
            self._forces.select(acting)
            self._loads = self._forces.bind_loads(self._parts.cells, self._u0, self._u1)
            self._asked = None
        dead = self._dead
        # What is foreseen of a step is mostly what comes of it.
        if dead is None or self._asked != (t, dt) or not self._actions.dead:
            self._actions.set_time(t + dt / 2, dt)
            now: Array = self._actions.loads.vector.array_r
            if dead is None or not np.array_equal(now, dead):
                dead = now.copy()
            self._dead, self._asked = dead, (t, dt)
        out: Array = dead
        if self._loads is not None:
            out = out.copy()
            self._forces.set_time(t + dt / 2, dt)
            b = self._b.x
            b.array[:] = 0.0
            fem.assemble_vector(b.array, self._loads)
            b.scatter_reverse(la.InsertMode.add)
            out -= b.array[self._parts.rows.dofs]
        return out

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._actions.destroy()
        for vector in (self._d, self._f, self._a):
            vector.destroy()


class BodyForces(Watch):
    """Knows ρ of the present bodies; `destroy` frees the PETSc objects.

    Attributes:
        borne: Bodies in the step that was looked at last, and ρ in their frames [N]; None without.
        dt: Length of the last step [s].
    """

    remembered: ClassVar[Remembered] = same("dt")

    def __init__(self, stepper: Stepper, in_pieces: frozenset[str]) -> None:
        """Compile the forms. Collective.

        Args:
            stepper: Solves the steps.
            in_pieces: Parts named rigid whose cells are not connected through facets: forces from
                piece to piece are unknown, and ρ of their bodies is not known.
        """
        self._stepper, self._in_pieces = stepper, in_pieces
        self._linear = LinearForms(stepper.scene, stepper.forces)
        self.borne: tuple[Parts, Array] | None = None
        self.dt = 0.0
        self._parts: Parts | None = None
        self._mass: Mass | None = None
        self._force: Withheld | None = None
        self._system: object = None

    def bear(self, t: float, dt: float) -> None:
        """Find ρ of the step that has been solved. Collective.

        Args:
            t: Time at its start [s].
            dt: Its length [s].
        """
        with _BEARING:
            self._follow()
            self.borne = None
            if self._parts is not None and self._force is not None:
                self.borne = self._parts, self._force.force(t, dt)

    def _follow(self) -> None:
        """Bind the present bodies. Collective."""
        if self._stepper.system is self._system:
            return
        self._system = self._stepper.system
        records, before = (
            watched(self._stepper.state.bodies.of.records, self._in_pieces),
            self._parts,
        )
        if before is None or [*map(id, records)] != [*map(id, before.bodies)]:
            self._drop()
            if records:
                self._have(records)
        if self._force is not None:
            self._force.destroy()
            self._force = None
        if self._parts is not None:
            assert self._mass is not None
            self._force = Withheld(self._stepper, self._parts, self._mass, self._linear)

    def _have(self, records: list[RigidBody]) -> None:
        self._parts = parts = Parts(self._stepper.scene, self._stepper.forces, records)
        self._mass = parts.mass()
        shape = self._linear.shape.x
        shape.array[:] = 0.0
        shape.array[parts.rows.dofs] = parts.shape
        shape.scatter_forward()

    def forget(self) -> None:
        """Tell no forces of the present bodies any more. Collective."""
        self._drop()
        self._system, self.borne = self._stepper.system, None

    def refresh(self) -> None:
        """See `Watch`."""
        self.borne = None

    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        self.dt = attempt.dt

    def named(self) -> list[tuple[RigidBody, Array]]:
        """Bodies with parts named rigid, and ρ in their frames, shape (nodes, 3) [N]."""
        if self.borne is None:
            return []
        parts, force = self.borne
        return [(b, force[at]) for b, at in zip(parts.bodies, parts.at, strict=True) if b.named]

    def _drop(self) -> None:
        for item in (self._force, self._mass):
            if item is not None:
                item.destroy()
        self._parts = self._mass = self._force = None

    def destroy(self) -> None:
        """Free the PETSc objects; the last forces may still be asked for. Collective."""
        self._drop()
