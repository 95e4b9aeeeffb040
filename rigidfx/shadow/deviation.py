"""How far a run is from what it would be without rigid parts: its error, as a motion.

What bodies would have to resist by straining, ρ, is what the equations of all cells are out of
balance by in the motion of the run. So the difference e to the flexible twin obeys

    M ë + C ė + K e = ρ + f_a ,    ė = ΔV at a switch, the velocities that it takes out,

with all cells of the structure, about the shape that it has, and f_a of what releases let down.
Unlike what a body bends by, e knows what hangs on it, what resonates with it, and what is left of
bodies that there were. It is linear: a structure that turns or bends far has its equations anew,
and e turns with it, as what bends an arm would stretch it after a turn.

e has steps of its own, as long as what moves allows, so that factors serve all run long. What
would have to be known besides is not there: where contacts act, where parts are named rigid, where
no support holds, and beyond `MOST` unknowns nobody follows e.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.coupling.rows import Rows
from rigidfx.effects import Rigid, Spring
from rigidfx.scene.scene import Scene
from rigidfx.shadow.ground import ground_of
from rigidfx.shadow.linear_motion import LinearMotion
from rigidfx.shadow.parts import mass_of
from rigidfx.shadow.shadow import Shadow
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt
from rigidfx.step.watches.watch import Watch

__all__ = ["Deviation", "can_be_followed"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

# What PETSc's log calls this part of a run.
_FOLLOWING = PETSc.Log.Event("rigidfxDeviation")

MOST = 5000  # unknowns: beyond, steps and factors of all cells take more time than bodies save
RESOLVED = 0.4  # of the time in which what moves turns round, 1/ω, what e steps by
LONGEST = 4  # steps of the run, at most
MOVED = 0.1  # of a structure's length, by which it is in another shape


def can_be_followed(scene: Scene) -> bool:
    """Whether e may be known in a scene."""
    unknowns = 3 * scene.space.dofmap.index_map.size_global
    return bool(scene.supports) and not scene.named(Rigid) and unknowns <= MOST


class Deviation(Watch):
    """Follows e from the first freeze on; `destroy` frees the PETSc objects.

    Attributes:
        known: Whether it is followed: false from the first contact on.
    """

    def __init__(self, stepper: Stepper, shadow: Shadow, turning: Callable[[], float]) -> None:
        """Nothing is off.

        Args:
            stepper: Solves the steps.
            shadow: Knows ρ.
            turning: Says in what time what moves turns round, 1/ω [s].
        """
        self._stepper, self._shadow, self._turning = stepper, shadow, turning
        self._scene = scene = stepper.scene
        self.known, self._begun = True, False
        n = scene.owned_nodes
        self._u: Array = np.zeros((n, 3))
        self._v: Array = np.zeros((n, 3))
        self._impulse: Array = np.zeros((n, 3))  # since its last step ...
        self._span = 0.0  # ... and the time since then [s]
        self._far = 0.0
        self._motion: LinearMotion | None = None
        self._dt = self._of_run = 0.0  # length of its steps, and of the run's [s]
        self._mask: Bools = np.zeros(3 * n, dtype=bool)
        self._viscous: list[int] = []  # terms of viscosity in these equations
        self._shape = np.zeros((n, 3))  # displacements that they are about
        self._X = X = scene.space.tabulate_dof_coordinates()[:n]
        ends = np.array([-X.min(axis=0, initial=np.inf), X.max(axis=0, initial=-np.inf)])
        scene.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
        self._length = float(np.linalg.norm(ends.sum(axis=0)))

    @property
    def largest(self) -> float | None:
        """How far any node is off [m]; None if that is not known."""
        return self._far if self.known else None

    def velocities(self) -> Array | None:
        """Those of all owned nodes, before a switch [m/s]; None if nothing asks for them."""
        if not self.known:
            return None
        state = self._stepper.state
        state.rebuild()
        return state.v.x.array[: self._v.size].reshape(-1, 3).copy()

    def switched(self, before: Array | None) -> None:
        """Take note of a switch, and of the velocities before it [m/s]."""
        now = self.velocities()
        if before is not None and now is not None:
            self._v += before - now
            self._begun = True

    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        if self.known and self._begun:
            with _FOLLOWING:
                self._take(attempt)

    def _take(self, attempt: Attempt) -> None:
        """Take a step of the run. Collective."""
        actions = self._stepper.system.actions
        if actions.elastic - {Spring.__name__}:
            self.known = False
            self.destroy()
            return
        if self._shadow.borne is not None:
            parts, force = self._shadow.borne
            borne, _ = parts.in_space(force, self._stepper.state.bodies, np.zeros_like(self._u))
            self._impulse += attempt.dt * borne
        for eased in actions.easing:
            eased.add_impulse(attempt.dt, self._impulse.reshape(-1))
        self._span += attempt.dt
        self._follow(attempt.dt)
        self._adapt(attempt.dt)
        while self._span >= self._dt * (1 - 1e-9):
            self._step()

    def _follow(self, dt: float) -> None:
        """Have equations about the present shape. Collective.

        Args:
            dt: Length of the step [s].
        """
        state, mask = self._stepper.state, self._stepper.prescribed.mask[: self._u.size]
        u = state.u.x.array[: self._u.size].reshape(-1, 3)
        moved = float(np.linalg.norm(u - self._shape, axis=1).max(initial=0.0))
        viscous = [k for k, _ in self._stepper.forces.viscous_terms]
        new = self._motion is None or viscous != self._viscous or bool((mask != self._mask).any())
        here = np.array([moved / self._length, float(new)])
        self._scene.comm.Allreduce(MPI.IN_PLACE, here, op=MPI.MAX)
        if here[0] <= MOVED and not here[1]:
            return
        self.destroy()
        state.rebuild()
        turn = self._turn(u)
        self._u, self._v = self._u @ turn.T, self._v @ turn.T
        self._mask, self._shape, self._viscous = mask.copy(), u.copy(), viscous
        self._u[mask.reshape(-1, 3)] = 0.0
        self._v[mask.reshape(-1, 3)] = 0.0
        self._motion = self._equations(dt)

    def _turn(self, u: Array) -> Array:
        """The rotation that takes the last shape best to the present one, shape (3, 3). Collective.

        Args:
            u: Displacements of the owned nodes [m].
        """
        a, b = self._X + self._shape, self._X + u
        sums = np.concatenate([[len(a)], a.sum(axis=0), b.sum(axis=0), (b.T @ a).reshape(-1)])
        self._scene.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        products = sums[7:].reshape(3, 3) - np.outer(sums[4:7], sums[1:4]) / sums[0]
        W, _, Vt = np.linalg.svd(products)
        return np.asarray(W @ np.diag([1.0, 1.0, np.linalg.det(W @ Vt)]) @ Vt)

    def _adapt(self, dt: float) -> None:
        """Have steps that resolve what moves, and are as long as that allows.

        Args:
            dt: Length of the step of the run [s].
        """
        longest = LONGEST * dt
        # Where nothing pushes, e rings on, and any step keeps its size.
        if self._shadow.borne is not None or self._stepper.system.actions.easing:
            longest = min(RESOLVED * self._turning(), longest)
        if not 0.5 * longest <= self._dt <= longest:
            self._dt, self._of_run = max(int(longest / dt), 1) * dt, dt

    def _equations(self, dt: float) -> LinearMotion:
        """Those of all cells. Collective."""
        scene, forces, linear = self._scene, self._stepper.forces, self._shadow.linear
        nodes = np.arange(scene.owned_nodes, dtype=np.int32)
        rows = Rows(scene.space, nodes)
        owned = scene.mesh.topology.index_map(scene.mesh.topology.dim).size_local
        cells = forces.cells(np.arange(owned, dtype=np.int32))
        before = linear.shape.x.array.copy()
        linear.shape.x.array[:] = self._stepper.state.u.x.array
        forces.set_rate(1.0)
        supported = np.flatnonzero(self._mask)
        mass, ground = mass_of(scene, rows, cells), ground_of(scene, rows)
        out = LinearMotion(rows, cells, linear, mass, supported, ground=ground)
        forces.set_rate(1 / dt)
        linear.shape.x.array[:] = before
        return out

    def _step(self) -> None:
        """A step of e under the mean force since the last one. Collective."""
        assert self._motion is not None
        dt = self._dt
        mean = np.asarray(self._impulse / self._span)
        drag, xi = self._scene.damping(self._stepper.state.t)
        # ξ is a viscosity by the steps of the run.
        xi *= self._of_run / dt
        d = self._motion.increment(mean, self._u, self._v, dt, drag, xi)
        self._u, self._v = self._u + d, 2 / dt * d - self._v
        self._span -= dt
        self._impulse = self._span * mean
        here = float(np.linalg.norm(self._u, axis=1).max(initial=0.0))
        self._far = self._scene.comm.allreduce(here, op=MPI.MAX)

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        if self._motion is not None:
            self._motion.destroy()
            self._motion = None
