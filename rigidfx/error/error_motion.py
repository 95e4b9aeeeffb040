"""The error motion e: the difference between a run with rigid parts and its flexible twin.

In a run with rigid parts the equations of all nodes hold, except at the nodes of bodies, where the
residual is ρ. A freeze also removes velocities ΔV. To first order the twin is u + e with

    M ë + C ė + K e = r ,     r = ρ and the forces that releases let down,     ė += ΔV      (1)

over all cells, flexible and rigid, about the shape at the first freeze, or a later one (`held`). r
is given in each body's own frame, r⁰ = Q_bᵀ r with Q_b the best rotation of the body's nodes
against the shape (2): a large pair of inner forces, rotated by a small angle, is a net load.

The shown place of a node is x + Q_p e, with one rotation Q_p for each connected part (3), so that
it is smooth in time through freezes and releases.

Parts named `Rigid`, and rigid faces, have many times their stiffness in K. Contacts of the twin act
on u + e; its joints hold u + e. For parts that move freely e has no rigid motions; it is not shown.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.effects import Contact
from rigidfx.error.contacts import Contacts
from rigidfx.error.ending import Ending, Promise, or_dropped
from rigidfx.error.equations import SOLUTION, Equations
from rigidfx.error.frames import FRAMES, Frames, to_space
from rigidfx.error.impulse import Impulse
from rigidfx.error.linear_motion import step_kind
from rigidfx.error.response import Response
from rigidfx.error.validity import Validity
from rigidfx.flexible.cell_strains import CellStrains
from rigidfx.flexible.indicator import Indicator
from rigidfx.scene.points import Point
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt, Watch
from rigidfx.withheld.body_forces import BodyForces

__all__ = ["ErrorMotion", "Shown"]

Nodes = npt.NDArray[np.integer]

_FOLLOWING = PETSc.Log.Event("rigidfxErrorMotion")  # what PETSc's log calls this part of a run
LOOKS = 4  # steps from look to look: at the size of e, and at cells that it hardly strains

# Kicks, response and contacts, and how many steps there were, before an attempt.
_Before = tuple[Array, object, object, int]


@dataclass(frozen=True)
class Shown:
    """The error motion in space at an instant.

    Attributes:
        displacement: Q_p e of the owned nodes, shape (nodes, 3) [m].
        velocity: Q_p ė, likewise [m/s].
    """

    displacement: Array
    velocity: Array


def of_point(point: Point, nodes: int) -> csr_array:
    """The displacement of a point, by weights of this rank's dofs.

    Args:
        point: Weighted nodes.
        nodes: Number of owned nodes.

    Returns:
        Shape (3, 3 · nodes).
    """
    dofs = 3 * point.nodes[:, None] + np.arange(3)
    axes = np.broadcast_to(np.arange(3), dofs.shape)
    weights = np.repeat(point.weights, 3)
    return csr_array((weights, (axes.ravel(), dofs.ravel())), shape=(3, 3 * nodes))


class ErrorMotion(Watch):
    """Follows e from the first freeze on; `destroy` frees the PETSc objects.

    Attributes:
        ending: Lets e go where it is small, and tells how large it was.
        validity: Tells where e is not small.
        steps: How many steps e has taken, looks included. It takes none at rest.
    """

    remembered: ClassVar[Remembered] = same("steps", "_failure")
    remembered |= {"_frames": FRAMES, "_equations": SOLUTION}
    remembered |= dict.fromkeys(("_impulse", "_contacts", "validity", "ending"), PART)

    def __init__(
        self,
        stepper: Stepper,
        forces: BodyForces,
        points: Mapping[str, Point],
        indicator: Indicator,
        promise: Promise,
    ) -> None:
        """Nothing is off.

        Args:
            stepper: Solves the steps.
            forces: Knows ρ.
            points: Points at which e is asked for, by name.
            indicator: A measure of its own for strains of e.
            promise: Bounds of e.
        """
        self._stepper, self._forces, self._promise = stepper, forces, promise
        self._scene = scene = stepper.scene
        self._sums = {name: of_point(p, scene.owned_nodes) for name, p in points.items()}
        self._strains = CellStrains(scene, stepper.forces, indicator)
        self.steps, self._failure = 0, ""
        self._begin()

    def _begin(self) -> None:
        """Nothing is off. Collective."""
        self._equations = Equations(self._stepper, [*self._sums.values()])
        self._impulse = Impulse(self._stepper, self._forces)
        self._frames: Frames | None = None  # against the shape of K
        self._contacts = Contacts(self._stepper) if self._scene.named(Contact) else None
        self._before: _Before | None = None  # a look at an attempt, if it is no step yet
        self.validity, self.ending = Validity(self._scene), Ending(self._stepper, self._promise)

    def drop(self, error: Exception) -> None:
        """Begin anew after a failure. Collective."""
        self.destroy()
        self._forces.forget()
        self._begin()
        self._failure = str(error) or type(error).__name__

    def failed(self) -> str:
        """How e has failed since this was asked last; empty if it has not."""
        failure, self._failure = self._failure, ""
        return failure

    @property
    def all_shown(self) -> bool:
        """Whether e is added to the displacements shown, in all parts."""
        equations = self._equations
        return bool(equations.known and equations.all_held and self.validity.placed.all())

    def shown(self) -> Shown | None:
        """e in space, zero in parts that nothing holds; None while unknown or zero. Collective."""
        frames, response = self._frames, self._response
        known = self._equations.known and self.validity.placed.any()
        if frames is None or response is None or not known:
            return None
        Q = frames.now(self._stepper.state, ~self.hidden())[frames.part]
        return Shown(*(to_space(a, Q) for a in response.fields()))

    def at(self, points: Mapping[str, Point]) -> Mapping[str, Shown]:
        """e in space at points given at the start, by name, shape (3,) each [m, m/s]. Collective.

        Nothing while it is zero, or not known.
        """
        frames, response = self._frames, self._response
        if not points or not self._equations.known or frames is None or response is None:
            return {}
        Q = frames.now(self._stepper.state, ~self.hidden())
        part = frames.parts_at([p.nodes for p in points.values()])
        own = np.stack(response.at([self._sums[name] for name in points]))
        moved, rate = (to_space(a, Q[part]) for a in self._scene.sum(own))
        return {name: Shown(moved[k], rate[k]) for k, name in enumerate(points)}

    def reactions(self, dt: float) -> Mapping[str, Array]:
        """What `Reactions.of` tells of the last step, of Δt [s]; none where e is not small."""
        known, response, state = self._equations.reactions, self._response, self._stepper.state
        if known is None or response is None or self._frames is None or not self._told.any():
            return {}
        xi, turned = self._scene.damping(state.t)[1], self._frames.now(state, self._told)
        return known.of(response, dt, xi, turned, state.places)

    def touches(self) -> Mapping[str, Array]:
        """Forces of contacts on u + e less those on u, by title: see `Contacts.apart`."""
        contacts = self._contacts
        return {} if contacts is None or not self._told.any() else contacts.apart

    def motion(self) -> tuple[fem.Function, fem.Function] | None:
        """The shape, and e in its frame [m] at the present time, ghosts included. Collective.

        None while unknown; zero in parts where e is not small. Parts that nothing holds have e.
        """
        response, frames = self._response, self._frames
        if response is None or frames is None or not self._told.any():
            return None
        e = np.where(self._told[frames.part, None], response.fields()[0], 0.0)
        out = fem.Function(self._scene.space)
        out.x.array[: e.size] = e.reshape(-1)
        out.x.scatter_forward()
        return self._equations.shape, out

    def hidden(self) -> Bools:
        """Connected parts to whose displacements e is not added. Collective."""
        if self._frames is None or not self._equations.known:
            return np.ones_like(self.validity.placed)
        return ~self.validity.placed | self._frames.parts_with(self._equations.unheld)

    @or_dropped
    def rates(self, cells: Indices) -> Array:
        """Strain rates of e over its last step, or since they were asked for. Collective.

        In the criterion's measure; the second where e is known by modes.

        Args:
            cells: Owned cells.

        Returns:
            Of each of the cells [1/s]; zero while e is, or is not known.
        """
        if self._response is None:
            return np.zeros(len(cells))
        return self._strains.of(*self._response.change(), self._equations.shape, cells)

    def size(self) -> float:
        """Largest |e| of any node [m]. Collective."""
        e = np.zeros((1, 3)) if self._response is None else self._response.coarse()
        here = np.linalg.norm(e, axis=1).max(initial=0.0)
        return float(self._scene.comm.allreduce(here, op=MPI.MAX))

    @or_dropped
    def strains(self, cells: Indices) -> Array:
        """Strains of e at the end of its last step, in the same measure [-]. See `rates`."""
        if (response := self._response) is None:
            return np.zeros(len(cells))
        return self._strains.of(response.fields()[0], 1.0, self._equations.shape, cells)

    @property
    def _response(self) -> Response | None:
        return self._equations.response

    @or_dropped
    def moved(self) -> tuple[Array, Indices]:
        """Withheld motion of bodies: e without their rigid motions, in space. Collective.

        Returns:
            Displacements of the owned nodes, zero outside, shape (nodes, 3) [m]; the bodies' cells.
        """
        out = np.zeros((self._scene.owned_nodes, 3))
        if self._frames is None or self._response is None:
            return out, np.empty(0, np.int32)
        return self._impulse.in_space(self._response.fields()[0], self._frames, out)

    @or_dropped
    def withheld(self) -> float:
        """Strain energy that bodies withhold, ½ ρᵀe, no less than zero [J]. Collective."""
        if self._frames is None or self._response is None:
            return 0.0
        return self._impulse.withheld(self._response.fields()[0], self._frames)

    @property
    def _told(self) -> Bools:
        """Connected parts in which it tells the strains of e, shape (parts,)."""
        return self.validity.holds & self._equations.known

    # Switches -----------------------------------------------------------------------------------

    def before_switch(self) -> tuple[Array, list[Nodes]]:
        """Velocities [m/s] and bodies' nodes before a switch. Collective."""
        self._take_back()
        bodies = self._stepper.state.bodies.of.records
        return self._impulse.velocities(), [body.nodes for body in bodies]

    def switched(self, before: tuple[Array, list[Nodes]], impact: bool = False) -> None:
        """Add velocities that a switch, or an `impact`, took out since `before`. Collective."""
        state = self._stepper.state
        if self._frames is None:
            if impact or not len(state.bodies):
                return
            self._frames = Frames(self._scene, state.places)
        velocities, nodes = before
        sets = [*nodes, *(body.nodes for body in state.bodies.of.records)]
        lost = velocities - self._impulse.velocities()
        if impact:
            self._equations.struck(lost)
        self._impulse.switched(lost, sets, self._frames)

    # Steps --------------------------------------------------------------------------------------

    @or_dropped
    def look(self, attempt: Attempt) -> bool:
        """Follow ρ and e in an attempt at a step, which may become one. Collective.

        Another look, or a switch, takes its steps of e back. `rates` and `strains` are at its end.

        Args:
            attempt: The attempt.

        Returns:
            Whether e has taken a step.
        """
        self._take_back()
        self._forces.bear(attempt.t, attempt.dt)
        if self._frames is None:
            return False
        with _FOLLOWING:
            kick = self._equations.have(attempt.dt, self._frames, self._impulse.kick)
            assert self._response is not None
            contacts = None if self._contacts is None else self._contacts.kept()
            self._before = kick, self._response.kept(), contacts, self.steps
            self._impulse.kick = kick
            self._take(attempt, self._frames)
        return self.steps > self._before[3]

    def _take_back(self) -> None:
        """Be as before the last look, if that has not become a step."""
        if self._before is not None:
            assert self._response is not None
            self._impulse.kick, motion, contacts, self.steps = self._before
            self._response.restore(motion)
            if self._contacts is not None:
                self._contacts.restore(contacts)
        self._before = None

    def refresh(self) -> None:
        """See `Watch`."""
        if self._contacts is not None:
            self._contacts.refresh()

    @or_dropped
    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        before, self._before = self._before, None
        if before is None or self._frames is None or self._response is None:
            return
        if self._contacts is not None:
            self._contacts.accept()
        if self.steps > before[3]:
            if self.steps % LOOKS == 0:
                x = self._stepper.state.places
                free = self._frames.parts_with(self._equations.unheld)
                self.validity.look(attempt.end, self._response, x, self._frames.shape, free)
            self._equations.scale(self.ending.part(attempt.dt, self._response, self._frames.part))

    def _take(self, attempt: Attempt, frames: Frames) -> None:
        """Follow a step of the run; none at rest. Collective."""
        assert self._response is not None
        dt, impulse = attempt.dt, self._impulse
        force, contacts = impulse.force(dt, frames), self._contacts
        if contacts is not None:
            contacts.follow(attempt)
        moving = bool(force.any() or impulse.kick.any() or self._response.moving)
        if not self._scene.comm.allreduce(moving, op=MPI.LOR):
            if contacts is not None:
                contacts.rest()
            return
        loose = self._equations.loose
        self._response.kick(loose.still(impulse.kick))
        impulse.kick = np.zeros_like(impulse.kick)
        given = step_kind(dt, *self._scene.damping(self._stepper.state.t))
        self._equations.follow(attempt, frames)
        force = loose.balanced(force)
        if contacts is None:
            self._equations.step(force, given)
        else:
            Q = frames.now(self._stepper.state)[frames.part]
            self._equations.press(contacts, force, given, Q, self.steps)
        self.steps += 1

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._equations.destroy()
        if self._contacts is not None:
            self._contacts.destroy()
