"""The structure as it is now, some of its rigid parts flexible: its motion by forces on these.

The difference of two motions, e = ũ - u, obeys the equations of the whole structure under ρ: all of
it as it is now, other bodies condensed, springs and contacts as they are, in a step so long that
neither inertia nor viscosity counts. Newton's method goes from state to state,
g(u + e) - g(u) = ρ: at each iterate a step begins there, whose forces without an increment are
those of that state. The derivative of forces halfway is half the stiffness.
"""

from collections.abc import Sequence
from copy import deepcopy

import numpy as np
from petsc4py import PETSc

from rigidfx.base.matrices import free
from rigidfx.base.types import Array, Indices
from rigidfx.effects.nodes import Instant
from rigidfx.flexible.internal_forces import Cells
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.step.equations.division import Division
from rigidfx.step.equations.equations import Equations
from rigidfx.step.newton.factors import Factors
from rigidfx.step.stepper import Stepper

LONG = 1e4  # times the time so far: a step in which nothing but stiffness counts
UP_TO = 100_000  # unknowns that are factored for that: their factors take 2 GB, and ten seconds
BALANCED = 1e-5  # part of the forces that may be out of balance at the end
SLOW = 0.1  # part that a solve may leave before its factors are made anew
SOLVES = 20  # tried: with friction each leaves a third


def small_enough(stepper: Stepper) -> bool:
    """Whether the structure of a run may be factored as a whole."""
    return 3 * int(stepper.scene.space.dofmap.index_map.size_global) <= UP_TO


class Whole:
    """The equations of the structure, some rigid parts flexible; `destroy` frees them.

    They serve for a division and its effects; a state is taken over by `take`.
    """

    def __init__(self, stepper: Stepper, parts: Sequence[RigidBody]) -> None:
        """Bind all that acts to it. Collective."""
        scene, state, forces = stepper.scene, stepper.state, stepper.forces
        state.rebuild()
        self._stepper, self._parts, self._forces = stepper, parts, forces
        others = self._others()
        mask = stepper.flexible
        for data in parts:
            mask[data.cells] = True
        flexible = forces.cells(np.flatnonzero(mask).astype(np.int32))
        cells, nodes = _driven(stepper, parts)
        division = Division(flexible, others, cells, nodes, {})
        known = state, division, stepper.system.prescribed.active
        notes = deepcopy(state.notes)  # they follow its iterates
        self._equations = of = Equations("step", scene, forces, *known, notes=notes, instant=True)
        of.bind(scene.effects, stepper.system.acting, joints=False)
        self._layout, self._prolongation, self._actions = of.layout, of.prolongation, of.actions
        self._still = self._layout.rows.vector()
        self._y = of.prolongation.unknowns()
        self._rest = self._y.duplicate()  # what is out of balance as it is
        self._u = state.u.x.array
        # The run's state, and its u₁, while iterates are there.
        self._kept, self._end = state.snapshot(), forces.u1.x.array
        self._from, self._dt = others, 0.0
        self._factors: Factors | None = None

    def _others(self) -> Bodies:
        """The bodies that stay rigid, as they are now."""
        which = {id(data) for data in self._parts}
        every = self._stepper.state.bodies
        return Bodies.of_each(body for body in every if id(body.data) not in which)

    def take(self, dt: float) -> None:
        """Bind the state after a step of dt [s]; the first one's tangent is factored. Collective.

        The coefficients u₀ and u₁ of the forms are its own until `leave`.
        """
        state, forces = self._stepper.state, self._forces
        state.rebuild()
        self._kept, self._end = state.snapshot(), forces.u1.x.array.copy()
        self._dt, self._from = dt, self._others()
        forces.set_time(state.t, 0.0)
        self._begin(self._from)
        self._equations.residual(self._y, self._rest)
        if self._factors is None:
            self._equations.tangent()
            self._factors = Factors(self._equations)
            self._factors.renew()

    def _begin(self, bodies: Bodies) -> None:
        """Begin a step without an increment at the present u₀. Collective."""
        t, nothing = self._stepper.state.t, np.zeros(self._prolongation.prescribed.size)
        self._actions.set_time(t, self._dt)
        began = Instant(self._from, self._kept.u[self._layout.rows.dofs])
        self._actions.creep_for(t, began)
        self._equations.begin(LONG * t, self._still, nothing, bodies)
        self._y.set(0.0)

    def leave(self) -> None:
        """Bring u₀ and u₁ of the run back."""
        self._stepper.state.restore(self._kept)
        self._forces.u1.x.array[:] = self._end
        self._forces.set_rate(1 / self._dt)

    def displaced(self, forces: Sequence[Array]) -> list[Array] | None:
        """How far forces move the nodes of each part [m]; None without a balance. Collective."""
        given = self._collapsed(forces)
        balanced = self._balance(given)
        given.destroy()
        e = (self._u - self._kept.u).reshape(-1, 3)
        return [e[data.nodes] for data in self._parts] if balanced else None

    def _balance(self, given: PETSc.Vec) -> bool:
        """Go where forces on the unknowns lead, by Newton's method; whether they do. Collective.

        Contacts open and close. Factors are made anew where a solve leaves too much.
        """
        factors = self._factors
        assert factors is not None
        r, more = given.copy(), given.duplicate()
        size, left, tried = given.norm(), 1.0, 0
        while size > 0 and BALANCED < left < np.inf and tried < SOLVES:
            factors.solve(r, more)
            more.scale(0.5)
            self._go(more, r)
            r.axpy(-1.0, self._rest)
            r.aypx(-1.0, given)
            before, left, tried = left, r.norm() / size, tried + 1
            if max(BALANCED, SLOW * before) < left < np.inf:
                self._equations.tangent()
                factors.renew()
        r.destroy()
        more.destroy()
        return bool(size == 0 or left <= BALANCED)

    def _go(self, y: PETSc.Vec, r: PETSc.Vec) -> None:
        """Move all by increments of the unknowns, and have the residual there. Collective."""
        equations = self._equations
        equations.residual(y, r)
        self._actions.accept()
        self._stepper.state.shift(self._layout.rows.dofs, equations.d.array_r)
        bodies = self._prolongation.increments.end
        rest = np.zeros((len(bodies), 3))
        self._begin(bodies.moving(rest, rest))
        equations.residual(self._y, r)

    def _collapsed(self, forces: Sequence[Array]) -> PETSc.Vec:
        """Forces on the parts' nodes, on the unknowns. Collective."""
        f, out = self._layout.rows.vector(), self._y.duplicate()
        for data, force in zip(self._parts, forces, strict=True):
            f.array.reshape(-1, 3)[self._layout.rows.positions(data.nodes)] += force
        self._prolongation.collapse(f.array_r, self._prolongation.no_bodies, out)
        f.destroy()
        return out

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        free(self._factors, self._y, self._rest, self._still, self._equations)


def _driven(
    stepper: Stepper, parts: Sequence[RigidBody]
) -> tuple[Cells | None, dict[int, Indices]]:
    """Cells that supports still move where parts are flexible, and their owned nodes."""
    scene, state = stepper.scene, stepper.state
    wanted = {data.number for data in parts}
    others = [cells for number, cells in state.clamped.items() if number not in wanted]
    if not others:
        return None, {}
    cells = np.sort(np.concatenate(others))
    nodes = np.unique(scene.space.dofmap.list[cells])
    return stepper.forces.cells(cells), {0: nodes[nodes < scene.owned_nodes]}
