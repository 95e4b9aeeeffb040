"""The force that rigidity takes over from stiffness, at the nodes of bodies.

A body's nodes would have to resist, by straining,

    ρ = R̄ᵀ (f_ext - f_flexible - M (v₁ - v₀)/Δt - ½ (R₀ + R₁) f⁰)

in its frame: what loads and the flexible cells exert on them, less what moves them as they do move,
less the internal forces f⁰ of the shape that the body keeps, as the Energy–Momentum Method has them
of a shape that turns. R̄ is the rotation halfway through the step, and the mean of the rotations is
shorter: in a steady spin by ωΔt in a step f⁰ would be 1 - cos(ωΔt/2) too large.

On what flies freely, under dead loads that do not change, all of that follows from a few numbers of
each body, and so does a bound of how far it has changed: while that is next to nothing, the force
is taken for the last one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from mpi4py import MPI

from rigidfx.coupling.mass import Mass
from rigidfx.effects import Windowed
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.bodies import Bodies
from rigidfx.shadow.parts import Parts
from rigidfx.step.equations.actions import Actions
from rigidfx.step.equations.structure import BoundStructure
from rigidfx.step.stepper import Stepper

__all__ = ["Withheld"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class _Turning:
    """How bodies turn in a step: numbers of each, by which forces of inertia are linear in places.

    Attributes:
        gained: What their velocities gain [m/s², 1/s²], shape (bodies, 4, 3), as of `_momentary`.
        R: Rotations halfway, shape (bodies, 3, 3).
        shorter: Of their means in these frames, likewise.
    """

    gained: Array
    R: Array
    shorter: Array

    @property
    def relative(self) -> Array:
        """What velocities of places relative to the centres gain, in the frames [1/s²]."""
        return np.asarray(self.gained[:, 1:] @ self.R)


@dataclass(frozen=True)
class _Known:
    """A force, and what it was computed from.

    Attributes:
        force: ρ, shape (nodes, 3) [N].
        size: Its size [N/√kg].
        given: Loads on the nodes [N].
        apart: Size of these without what moves the bodies as a whole [N/√kg].
        turning: How the bodies turned.
    """

    force: Array
    size: float
    given: Array
    apart: float
    turning: _Turning


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
        self._structure = BoundStructure(
            scene=scene,
            rows=parts.rows,
            own=np.ones(parts.rows.nodes.size, dtype=bool),
            bodies=Bodies.of_each(()),
            mass=mass,
            u=self._u0.x.array,
            surface=forces.surface,
            failures=stepper.failures,
        )
        self._place(self._u0, stepper.state.bodies)
        self._acting: Sequence[Windowed] = stepper.system.acting
        self._actions = Actions(self._structure, scene.effects, self._acting)
        self._d, self._f, self._a = (parts.rows.vector() for _ in range(3))
        self._given: Array | None = None  # loads on the nodes in the last step
        self._dead: Array | None = None  # the last ones that do not follow the bodies, and
        self._asked: tuple[float, float] | None = None  # the step that they are of
        self._known: _Known | None = None  # while nothing touches the bodies
        # What the last force would have been computed from, if it was taken for another.
        self._left: tuple[_Turning, Array, float, Array] | None = None
        touched = any(own.size for own, _ in self._attached)
        self._untouched = not scene.comm.allreduce(touched, op=MPI.LOR)

    def _place(self, u: fem.Function, bodies: Bodies) -> None:
        """Set the displacement of the rows where bodies are. Collective."""
        x = self._parts.linear(bodies.pose[self._of])
        x -= self._parts.rows.X
        u.x.array[self._parts.rows.dofs] = x.reshape(-1)
        u.x.scatter_forward()

    def _momentary(self, bodies: Bodies) -> Array:
        """Of each body here its velocity, and ω × R of its frame, shape (bodies, 4, 3) [m/s, 1/s].

        A node at V in the frame has the velocity [1, V] times that.
        """
        turning = np.cross(bodies.angular_velocity[self._of][:, None], bodies.R[self._of].mT)
        return np.concatenate([bodies.velocity[self._of][:, None], turning], axis=1)

    def force(self, t: float, dt: float, little: float = 0.0) -> Array:
        """ρ of the step that has been solved last, in the bodies' frames. Collective.

        Args:
            t: Time at its start [s].
            dt: Its length [s].
            little: Part of its size by which it may have changed and be taken for the last one.

        Returns:
            Forces on the nodes of the rows, without what would move a body, shape (nodes, 3) [N];
            not to be changed.
        """
        system = self._stepper.system
        increments = system.equilibrium.prolongation.increments
        start, end = increments.start, increments.end
        if self._loads is not None or not system.dead:
            self._place(self._u0, start)
        if self._loads is not None:
            self._place(self._u1, end)
        given = self._given = self._loads_of(t, dt, system.acting)
        gained = self._momentary(end)
        gained -= self._momentary(start)
        gained /= dt
        W, shorter, Vt = np.linalg.svd(increments.R_av[self._of])
        turning = _Turning(gained, W @ Vt, Vt.mT * shorter[:, None] @ Vt)
        free, moved = self._untouched and system.dead, increments.displacement[self._of]
        if free and self._known is not None and self._same(self._known, turning, little):
            self._left = turning, moved, dt, given
            return self._known.force
        out, self._left = self.resisted(turning, moved, dt, given), None
        self._known = self._noted(out, given, turning) if free and little > 0 else None
        return out

    def exact(self, force: Array) -> Array:
        """ρ of the last step, also where it was taken for that of another. Collective.

        Args:
            force: What it was taken for.
        """
        left, self._left = self._left, None
        return force if left is None else self.resisted(*left)

    def resisted(self, turning: _Turning, moved: Array, dt: float, given: Array) -> Array:
        """ρ of bodies that turn so, and are displaced by `moved` in a step. Collective."""
        system, parts, f = self._stepper.system, self._parts, self._f
        # The residual of the nodes if they were flexible, but for what their own cells do. They
        # move as a body does: what they do is linear in their places in it.
        self._d.array[:] = parts.linear(moved).reshape(-1)
        self._a.array[:] = parts.linear(turning.gained).reshape(-1)
        self._mass.mult(self._a, f)
        f.array[:] -= given
        self._actions.resist_nodes(self._d, dt, f)
        residual = f.array.reshape(-1, 3)
        system.resist_at(parts.rows.nodes, residual)
        if not self._untouched:
            of_flexible = system.equilibrium.forces_out_of_balance.array_r.reshape(-1, 3)
            for own, active in self._attached:
                residual[own] += of_flexible[active]
        out = parts.turned(residual, -turning.R)
        out -= parts.turned(self._frozen, turning.shorter)
        parts.balance(out)
        return out

    def _noted(self, force: Array, given: Array, turning: _Turning) -> _Known:
        """A force and what it was computed from. Collective."""
        parts, before = self._parts, self._known
        if before is not None and self._everywhere(given is before.given):
            apart = before.apart
        else:
            apart = parts.size(parts.not_shifting(given.reshape(-1, 3)))
        return _Known(force, parts.size(force), given, apart, turning)

    def _same(self, known: _Known, turning: _Turning, little: float) -> bool:
        """Whether ρ has changed by no more than that part of its size. Collective.

        What moves bodies as a whole is no part of it: neither what shifts them, exactly, nor the
        rest of that, which makes it no larger.
        """
        parts = self._parts
        change = parts.size_of_linear(turning.relative - known.turning.relative)
        for size, now, before in (
            (known.apart, turning.R, known.turning.R),
            (self._size_of_frozen, turning.shorter, known.turning.shorter),
        ):
            change += size * float(np.linalg.norm(now - before, axis=(1, 2)).max(initial=0.0))
        same = self._given is known.given and change <= little * known.size
        return self._everywhere(same)

    @cached_property
    def _size_of_frozen(self) -> float:
        """Size of the internal forces of the shape that bodies keep [N/√kg]. Collective."""
        return self._parts.size(self._frozen)

    def _everywhere(self, here: bool) -> bool:
        """Whether something is so on all ranks. Collective."""
        return bool(self._stepper.scene.comm.allreduce(here, op=MPI.LAND))

    def rise(self, t: float, dt: float, alarming: Callable[[float], bool]) -> Array | None:
        """What loads on the bodies will change of ρ in a step from the present state. Collective.

        Args:
            t: Time at its start [s].
            dt: Its length [s].
            alarming: Whether a change of that size counts, equal on all ranks; 0 does not.

        Returns:
            Forces as `force` has them; None in a run's first step, and where they do not count.
        """
        bodies = self._stepper.state.bodies
        if self._loads is not None or self._given is None:  # loads that follow the bodies
            self._place(self._u0, bodies)
            self._place(self._u1, bodies)
        if self._given is None:
            # The equations are new. Follower loads are taken where the bodies are now.
            if t < dt:
                return None
            self._given = self._loads_of(t - dt, dt, self._stepper.scene.acting(t - dt / 2))
        now = self._loads_of(t, dt, self._stepper.system.acting)
        if self._everywhere(now is self._given):
            return None
        change = (now - self._given).reshape(-1, 3)
        # Neither turning nor balancing makes it larger.
        if not alarming(self._parts.size(change)):
            return None
        out = self._parts.turned(change, bodies.R[self._of])
        self._parts.balance(out)
        return out if alarming(self._parts.size(out)) else None

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
            now: Array = self._actions.external.array_r
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
