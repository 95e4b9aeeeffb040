"""ρ of the present bodies: the forces at their nodes that rigidity bears in place of stiffness.

docs/theory/shapes.md#withheld-forces has ρ, in the frame of a body. R̄ is the rotation halfway
through the step: by the mean of both, which is shorter, the internal forces f⁰ of the shape that
the body keeps would be 1 - cos(ωΔt/2) too large.
"""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.matrices import free
from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.effects import Windowed
from rigidfx.effects.nodes import Forces, Motion
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments, Step
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.step.equations.actions import apart
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt, Watch
from rigidfx.withheld.fields import Fields, Force
from rigidfx.withheld.parts import Parts, watched

# What PETSc's log calls this part of a run.
_BEARING = PETSc.Log.Event("rigidfxBodyForces")


class Withheld:
    """The force on the nodes of some bodies of a division; `destroy` frees its PETSc objects.

    Attributes:
        bodies: The bodies' data.
        fields: Of each; a part named `Reduced` has none: its forces are not evaluated.
    """

    def __init__(
        self,
        stepper: Stepper,
        linear: LinearForms,
        bodies: Sequence[RigidBody],
        fields: Sequence[Fields | None],
    ) -> None:
        """Bind the effects to the bodies' nodes; fields that are known of a body stay. Collective.

        The forms get the shape of the bodies.
        """
        self._stepper, self.bodies = stepper, tuple(bodies)
        self._parts = parts = Parts(stepper.scene, stepper.forces, bodies)
        self._mass = parts.mass()
        self.fields = self._fields_of_each(linear, fields)
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
        self._loads = forces.bind_loads(parts.cells, self._u0, self._u1)
        self._none = Bodies.of_each(())
        self._place(self._u0, parts.linear(stepper.state.bodies.pose[self._of]))
        self._acting: Sequence[Windowed] = stepper.system.acting
        known = scene, parts.rows, self._u0.x.array, forces.surface, self._acting
        self._actions = apart(*known, self._mass)
        self._d, self._f = (parts.rows.vector() for _ in range(2))
        self._products: dict[int, tuple[Array, Array]] = {}  # of bodies: loads, and h by them
        self._dead: Array | None = None  # the last ones that do not follow the bodies, and
        self._asked: tuple[float, float] | None = None  # the step that they are of
        touched = any(own.size for own, _ in self._attached)
        self._untouched = not scene.comm.allreduce(touched, op=MPI.LOR)

    def _fields_of_each(
        self, linear: LinearForms, known: Sequence[Fields | None]
    ) -> list[Fields | None]:
        """The fields of each body, those that are known or new ones. Collective."""
        scene, parts = self._stepper.scene, self._parts
        by_data = {id(own.data): own for own in known if own is not None}
        parts.shape_of(linear)
        b = fem.Function(scene.space)
        fem.assemble_vector(b.x.array, linear.force(parts.cells))
        b.x.scatter_reverse(la.InsertMode.add)
        frozen, out = b.x.array[parts.rows.dofs].reshape(-1, 3), []
        for data, at, places in zip(parts.bodies, parts.at, parts.coordinates, strict=True):
            own = by_data.get(id(data))
            # Forces on a part named `Reduced` are not evaluated: see ν.
            if own is None and (data.shapes is None or data.shapes.images.shape[1]):
                inert = self._mass.of_directions(at, places)
                own = Fields(scene, data, places, inert, frozen[at])
            out.append(own)
        return out

    def _place(self, u: fem.Function, x: Array) -> None:
        """Set the displacement of the rows that are at places x. Collective."""
        u.x.array[self._parts.rows.dofs] = (x - self._parts.rows.X).reshape(-1)
        u.x.scatter_forward()

    def force(self, t: float, dt: float) -> dict[int, tuple[Fields, Force]]:
        """Fields, and ρ without forces that would move a body, by numbers of bodies. Collective.

        They are of the step that has been solved last, of Δt from t [s].
        """
        increments = self._stepper.system.prolongation.increments
        start, end = increments.start, increments.end
        gained = np.asarray((end.pose_rate[self._of] - start.pose_rate[self._of]) / dt)
        W, shorter, Vt = np.linalg.svd(increments.R_av[self._of])
        R, means = W @ Vt, Vt.mT * shorter[:, None] @ Vt
        self._follow(increments)
        loads = self._loads_of(t, dt, self._stepper.system.acting)
        resisted, on_nodes = self._resisted(gained, dt), loads.reshape(-1, 3)
        half = _middle(start, end)[self._of]
        known, products = [], []
        for k, (fields, at) in enumerate(zip(self.fields, self._parts.at, strict=True)):
            if fields is not None:
                beside = -resisted[at] @ R[k]  # at few nodes
                products.append(fields.products(beside) + self._of_loads(k, loads) @ R[k])
                known.append((k, fields, beside + on_nodes[at] @ R[k]))
        total = self._stepper.scene.sum(np.concatenate([np.empty((0, 3)), *products]))
        out, first = {}, 0
        for k, fields, beside in known:
            h, n = total[first : first + fields.count], fields.data.deforms_by
            first += fields.count
            own = gained[k, : 4 + 3 * n] @ R[k], means[k], half[k, :n]
            out[fields.data.number] = fields, fields.force(*own, beside, h)
        return out

    def _of_loads(self, k: int, loads: Array) -> Array:
        """This rank's part of h of a body by loads, in space; it stays while these do."""
        fields, known = self.fields[k], self._products.get(k)
        assert fields is not None
        if known is None or known[0] is not loads:
            own = fields.products(loads.reshape(-1, 3)[self._parts.at[k]])
            self._products[k] = known = loads, own
        return known[1]

    def _follow(self, increments: Increments) -> None:
        """Bring the nodes to where bodies move them, for loads and actions that follow."""
        if self._loads is None and self._actions.dead:
            return
        numbers = np.concatenate([increments.start.pose, increments.displacement], axis=2)
        x, moved = np.split(self._parts.linear(numbers[self._of]), 2, axis=1)
        self._place(self._u0, x)
        if self._loads is not None:
            self._place(self._u1, x + moved)
        self._d.array[:] = moved.reshape(-1)

    def _resisted(self, gained: Array, dt: float) -> Array:
        """What bodies resist by more than their fields and loads in a step, (nodes, 3) [N]."""
        system, parts, f = self._stepper.system, self._parts, self._f
        # The residual of the nodes if they were flexible, but for what their own cells do. They
        # move as a body does: what they do is linear in their places in it.
        f.set(0.0)
        if self._mass.at_points:
            f.array[:] += self._mass.of_points(parts.linear(gained).reshape(-1))
        if not self._actions.dead:
            none = Increments(Step(self._none, dt), np.empty((0, 6)))
            self._actions.resist(Motion(self._d, none, dt), Forces.none(f))
        residual = f.array.reshape(-1, 3)
        system.resist_at_nodes(parts.rows.nodes, residual)
        if not self._untouched:
            of_flexible = system.forces_out_of_balance.array_r.reshape(-1, 3)
            for own, active in self._attached:
                residual[own] += of_flexible[active]
        return residual

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
        free(self._actions, self._d, self._f, self._mass)


def _middle(start: Bodies, end: Bodies) -> Array:
    """Coordinates with the elastic forces in the middle of a step, shape (bodies, m) [m]."""
    e, shapes = 0.5 * (start.stretched + end.stretched), end.of.shapes
    if shapes is not None:
        at = shapes.some
        e[at] = shapes.linear(0.5 * (start.q + end.q)[at], e[at])
    return e


class BodyForces(Watch):
    """Knows ρ of the present bodies; `destroy` frees the PETSc objects.

    Attributes:
        borne: Fields of bodies and ρ in the step that was looked at last, by the bodies' numbers.
        dt: Length of the last step [s].
    """

    remembered: ClassVar[Remembered] = same("dt")

    def __init__(self, stepper: Stepper, in_pieces: frozenset[str]) -> None:
        """Compile the forms. Collective.

        Of parts named rigid that are `in_pieces`, whose cells are not connected through facets,
        forces from piece to piece are unknown, and so is ρ of their bodies.
        """
        self._stepper, self._in_pieces = stepper, in_pieces
        self._linear = LinearForms(stepper.scene, stepper.forces)
        self.borne: dict[int, tuple[Fields, Force]] = {}
        self.dt = 0.0
        self._bearing: tuple[RigidBody, ...] = ()  # the bodies in that step
        self._force: Withheld | None = None
        self._system: object = None

    def bear(self, t: float, dt: float) -> None:
        """Find ρ of the step of Δt from t [s] that has been solved. Collective."""
        with _BEARING:
            self._follow()
            self.borne = {} if self._force is None else self._force.force(t, dt)
            self._bearing = () if self._force is None else self._force.bodies

    def _follow(self) -> None:
        """Bind the present bodies. Collective."""
        if self._stepper.system is self._system:
            return
        self._system = self._stepper.system
        known = [] if self._force is None else self._force.fields
        self._drop()
        if records := watched(self._stepper.state.bodies.of.records, self._in_pieces):
            self._force = Withheld(self._stepper, self._linear, records, known)

    def forget(self) -> None:
        """Tell no forces of the present bodies any more. Collective."""
        self._drop()
        self._system, self.borne, self._bearing = self._stepper.system, {}, ()

    def refresh(self) -> None:
        """See `Watch`."""
        self.borne, self._bearing = {}, ()

    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        self.dt = attempt.dt

    def named(self) -> list[tuple[RigidBody, Array]]:
        """Bodies with parts named rigid, and ρ in their frames, shape (nodes, 3) [N]."""
        out = []
        for data in (own for own in self._bearing if own.named):
            known = self.borne.get(data.number)
            out.append((data, 0 * data.offsets if known is None else known[0].at_nodes(known[1])))
        return out

    def _drop(self) -> None:
        if self._force is not None:
            self._force.destroy()
        self._force = None

    def destroy(self) -> None:
        """Free the PETSc objects; the last forces may still be asked for. Collective."""
        self._drop()
