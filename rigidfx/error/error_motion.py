"""The error motion e: how far a run with rigid parts is off its flexible twin.

In a run with rigid parts the equations of all nodes hold but those of bodies' nodes, which are out
of balance by ρ, and a freeze takes velocities ΔV out. To first order the twin is u + e with

    M ë + C ė + K e = r ,     r = ρ and the forces that releases let down,     ė += ΔV      (1)

over all cells, flexible and rigid, about the shape at the first freeze. r is given in each body's
own frame, r⁰ = Q_bᵀ r with Q_b the best rotation of the body's nodes against the shape (2): a large
pair of inner forces, turned by a small angle, would be a net load. One K serves the whole run.

A shown place is x + Q_p e with one rotation Q_p of each connected part (3), so that it is smooth in
time through freezes and releases.

Parts named `Rigid` are rigid in the twin, too: they have many times their stiffness in K. e is not
known from the first contact on, where no support holds, and beside a part of given mass or inertia.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.coupling.rows import Rows
from rigidfx.effects import Rigid, Spring
from rigidfx.error.frames import Frames, to_shape, to_space
from rigidfx.error.modal import Modal
from rigidfx.error.response import PREPARING, AllUnknowns, Response
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.scene.points import Point
from rigidfx.scene.scene import Scene
from rigidfx.shadow.ground import ground_of
from rigidfx.shadow.linear_motion import LinearMotion
from rigidfx.shadow.parts import mass_of
from rigidfx.shadow.shadow import Shadow
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt
from rigidfx.step.watches.watch import Watch

__all__ = ["ErrorMotion", "Shown", "can_be_followed"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Nodes = npt.NDArray[np.integer]

# What PETSc's log calls this part of a run.
_FOLLOWING = PETSc.Log.Event("rigidfxErrorMotion")

LARGEST = 12_000  # unknowns up to which e is solved for all of them; beyond, by modes
BOUNDED = 5000  # unknowns up to which |e| releases bodies: beyond, few scenes were tried
# Length of a step of e over 1/ω of the motion and of e, at most: a vibration of e is out of phase
# by (ω Δt)²/12 a radian.
RESOLVED = 0.2
LONGEST = 4  # steps of the run in a step of e, at most


def can_be_followed(scene: Scene) -> bool:
    """Whether e may be known in a scene."""
    return bool(scene.supports) and not any(rigid.given for rigid in scene.named(Rigid))


@dataclass(frozen=True)
class Shown:
    """The error motion in space at an instant.

    Attributes:
        displacement: Q_p e of the owned nodes, shape (nodes, 3) [m].
        velocity: Q_p ė, likewise [m/s].
    """

    displacement: Array
    velocity: Array


class ErrorMotion(Watch):
    """Follows e from the first freeze on; `destroy` frees the PETSc objects.

    Attributes:
        known: Whether it is followed: false from the first contact on.
    """

    def __init__(
        self,
        stepper: Stepper,
        shadow: Shadow,
        turning: Callable[[], float],
        points: Mapping[str, Point],
    ) -> None:
        """Nothing is off.

        Args:
            stepper: Solves the steps.
            shadow: Knows ρ.
            turning: Returns 1/ω of the motion [s].
            points: Points at which e is asked for, by name.
        """
        self._stepper, self._shadow, self._turning = stepper, shadow, turning
        self._points = points
        self._scene = scene = stepper.scene
        self.known = True
        unknowns = 3 * scene.space.dofmap.index_map.size_global
        self._bounded, self._few = unknowns <= BOUNDED, unknowns <= LARGEST
        self._forms = LinearForms(scene, stepper.forces)
        n = scene.owned_nodes
        self._nodes = np.arange(n)
        self._kick: Array = np.zeros((n, 3))  # velocities taken out since the last step [m/s]
        self._impulse: Array = np.zeros((n, 3))  # since the last step of e [N s] ...
        self._span = 0.0  # ... and the time since then [s]
        self._size: float | None = 0.0
        self._response: Response | None = None
        self._frames: Frames | None = None  # against the shape at the first freeze
        self._of_bodies: dict[int, tuple[object, Array]] = {}  # Q_b at their freeze, by number
        self._dt = self._of_run = 0.0  # length of the steps of e, and of the run's [s]
        self._mask: Bools = np.zeros(3 * n, dtype=bool)
        self._viscous: list[int] = []  # terms of viscosity in these equations

    @property
    def largest(self) -> float | None:
        """Largest |e| of any node [m], by which bodies are released; None if none is by that."""
        return self._size if self.known and self._bounded else None

    def shown(self) -> Shown | None:
        """e in space at the present time; None while it is zero, or not known. Collective."""
        if self._frames is None or (response := self._valid()) is None:
            return None
        Q = self._frames.of_parts(self._stepper.state.positions(self._nodes))[self._frames.part]
        e, rate = response.fields()
        return Shown(to_space(e + self._span * rate, Q), to_space(rate, Q))

    def at(self, points: Mapping[str, Point]) -> Mapping[str, Array]:
        """e in space at points that were given at the start, by name [m]. Collective.

        Returns:
            Shape (3,) each; nothing while e is zero, or not known.
        """
        if self._frames is None or not points or (response := self._valid()) is None:
            return {}
        Q = self._frames.of_parts(self._stepper.state.positions(self._nodes))
        part = self._frames.parts_at([point.nodes for point in points.values()])
        e, rate = self._scene.sum(np.stack(response.at([*points.values()])))
        return dict(zip(points, to_space(e + self._span * rate, Q[part]), strict=True))

    def _valid(self) -> Response | None:
        """The response, where it may be shown."""
        response = self._response if self.known else None
        return response if response is not None and response.valid else None

    # Switches -----------------------------------------------------------------------------------

    def before_switch(self) -> tuple[Array, list[Nodes]] | None:
        """Velocities [m/s] and bodies' nodes before a switch; None if e is not followed."""
        if not self.known:
            return None
        return self._velocities(), [body.nodes for body in self._stepper.state.bodies.of.records]

    def switched(self, before: tuple[Array, list[Nodes]] | None) -> None:
        """Add the velocities that a switch has taken out. Collective.

        Args:
            before: Of `before_switch`.
        """
        if before is None or not self.known:
            return
        state = self._stepper.state
        x = state.positions(self._nodes)
        if self._frames is None:
            self._frames = Frames(self._scene, x)
        velocities, nodes = before
        taken = velocities - self._velocities()
        Q = self._frames.of_parts(x)[self._frames.part]
        sets = [*nodes, *(body.nodes for body in state.bodies.of.records)]
        for own, R in zip(sets, self._frames.of_sets(sets, x), strict=True):
            Q[own] = R
        self._kick += to_shape(taken, Q)

    def _velocities(self) -> Array:
        state = self._stepper.state
        state.rebuild()
        return state.v.x.array[: self._kick.size].reshape(-1, 3).copy()

    # Steps --------------------------------------------------------------------------------------

    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        if self.known and self._frames is not None:
            with _FOLLOWING:
                self._take(attempt, self._frames)

    def _take(self, attempt: Attempt, frames: Frames) -> None:
        """Take a step of the run. Collective."""
        actions = self._stepper.system.actions
        if actions.elastic - {Spring.__name__}:
            self.known = False
            self.destroy()
            return
        self._bear(attempt.dt, frames)
        self._span += attempt.dt
        self._have_equations(attempt.dt)
        self._adapt(attempt.dt)
        while self._span >= self._dt * (1 - 1e-9):
            self._step()

    def _bear(self, dt: float, frames: Frames) -> None:
        """Add r of a step of length dt [s] to the impulse, in the shape's frame. Collective."""
        if self._shadow.borne is not None:
            parts, force = self._shadow.borne
            for body, at in zip(parts.bodies, parts.at, strict=True):
                self._impulse[body.nodes] += dt * to_shape(force[at], self._frame_of(body, frames))
        easing = self._stepper.system.actions.easing
        if easing:
            let_down = np.zeros_like(self._impulse)
            for eased in easing:
                eased.add_impulse(dt, let_down.reshape(-1))
            x = self._stepper.state.positions(self._nodes)
            loaded = np.flatnonzero(np.abs(let_down).max(axis=1))
            Q = frames.of_sets([loaded], x)[0]
            self._impulse += to_shape(let_down, Q)

    def _frame_of(self, body: Any, frames: Frames) -> Array:
        """Q of a body's own frame against the shape, (2): it is constant. Collective."""
        known = self._of_bodies.get(body.number)
        if known is None or known[0] is not body:
            x = np.zeros_like(frames.shape)
            x[body.nodes] = body.offsets
            known = body, frames.of_sets([body.nodes], x)[0]
            self._of_bodies[body.number] = known
        return known[1]

    def _have_equations(self, dt: float) -> None:
        """Have the equations of the supports and viscosities that act. Collective.

        Args:
            dt: Length of the step of the run [s].
        """
        mask = self._stepper.prescribed.mask[: self._mask.size]
        viscous = [k for k, _ in self._stepper.forces.viscous_terms]
        new = self._response is None or viscous != self._viscous or bool((mask != self._mask).any())
        if not self._scene.comm.allreduce(new, op=MPI.LOR):
            return
        e, rate = np.zeros((2, *self._kick.shape))
        if self._response is not None:
            e, rate = (np.where(mask.reshape(-1, 3), 0.0, a) for a in self._response.fields())
        self.destroy()
        self._mask, self._viscous = mask.copy(), viscous
        with PREPARING:
            motion = self._equations(dt)
        held = np.flatnonzero(mask)
        if self._few:
            self._response = AllUnknowns(self._scene, motion, e, rate)
        else:
            points = [*self._points.values()]
            self._response = Modal(self._scene, motion, held, points, e, rate)

    def _equations(self, dt: float) -> LinearMotion:
        """Those of all cells about the shape. Collective."""
        scene, forces, frames = self._scene, self._stepper.forces, self._frames
        assert frames is not None
        rows = Rows(scene.space, self._nodes.astype(np.int32))
        owned = scene.mesh.topology.index_map(scene.mesh.topology.dim).size_local
        cells = forces.cells(np.arange(owned, dtype=np.int32))
        shape = self._forms.shape.x
        X = self._stepper.state.X[: len(frames.shape)]
        shape.array[: self._kick.size] = (frames.shape - X).reshape(-1)
        shape.scatter_forward()
        forces.set_rate(1.0)
        supported = np.flatnonzero(self._mask)
        mass, ground = mass_of(scene, rows, cells), ground_of(scene, rows)
        named = [scene.owned_cells(part.where, part.kind) for part in scene.named(Rigid)]
        rigid = forces.cells(np.unique(np.concatenate(named)).astype(np.int32)) if named else None
        out = LinearMotion(rows, cells, self._forms, mass, supported, ground=ground, rigid=rigid)
        forces.set_rate(1 / dt)
        return out

    def _adapt(self, dt: float) -> None:
        """Choose the length of steps: long ones where motion and e allow them. Collective.

        Steps have two lengths, so that factors are few. A force on an e at rest may be a wave that
        arrives: its first steps are short.

        Args:
            dt: Length of the step of the run [s].
        """
        assert self._response is not None
        resolved = RESOLVED * min(self._turning(), self._response.slowness)
        longest = max(min(LONGEST * dt, resolved), dt)
        if not 0.5 * longest <= self._dt <= longest:
            self._dt, self._of_run = LONGEST * dt if resolved >= LONGEST * dt else dt, dt

    def _step(self) -> None:
        """Take a step of e under the mean force since the last one; none at rest. Collective."""
        assert self._response is not None
        dt, mean = self._dt, np.asarray(self._impulse / self._span)
        self._span -= dt
        self._impulse = self._span * mean
        moving = bool(mean.any() or self._kick.any() or self._response.moving)
        if not self._scene.comm.allreduce(moving, op=MPI.LOR):
            return
        self._response.kick(self._kick)
        self._kick = np.zeros_like(self._kick)
        drag, xi = self._scene.damping(self._stepper.state.t)
        # ξ is a viscosity by the steps of the run.
        self._response.step(mean, dt, drag, xi * self._of_run / dt)
        self._size = self._response.size

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        if self._response is not None:
            self._response.destroy()
            self._response = None
