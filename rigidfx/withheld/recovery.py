"""Strains of parts named rigid, for stresses that are asked for.

The forces on its nodes strain such a part by its own stiffness, K⁺ρ. Where more than its own
supports bear the loads, or where it would bend by so much that a linear response does not balance
the forces (stresses of a bar whose tip went 4 % of its length were 4 % off, by turns alone), the
whole structure is solved with it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from rigidfx.base.matrices import free
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.linear.linear_solver import solver_of
from rigidfx.mechanics.rigid_body import RigidBody, outside
from rigidfx.mechanics.rigid_motions import determining, fitted_motion, free_motions, rigid_motions
from rigidfx.step.equations.supports import PrescribedDofs
from rigidfx.step.stepper import Stepper
from rigidfx.withheld.body_forces import BodyForces
from rigidfx.withheld.held_parts import HeldParts
from rigidfx.withheld.parts import Parts
from rigidfx.withheld.whole import Whole, small_enough

BENDS = 0.02  # part of its length that a part may move within itself by a linear response


class AtRest:
    """Some bodies or parts with the factor of their stiffness; `destroy` frees it.

    Attributes:
        bodies: Their data.
    """

    def __init__(
        self, stepper: Stepper, linear: LinearForms, bodies: Sequence[RigidBody], held: Bools
    ) -> None:
        """Factor the stiffness by forms that get the shape of the bodies. Collective.

        Bodies share no node; held are, of each owned node, the components that supports hold.
        """
        self._scene = scene = stepper.scene
        comm = scene.comm
        self.bodies = tuple(bodies)
        self._parts = parts = Parts(scene, stepper.forces, bodies)
        rows = parts.rows
        parts.shape_of(linear)
        K = rows.assembled(linear.stiffness(parts.cells))
        self._right, self._found = K.getDiagonal(), rows.vector()
        scale = float(self._right.norm()) / np.sqrt(comm.size)
        supported = held[rows.nodes]
        self._free: list[Array] = []  # motions of each that no support prevents, (3 nodes, k)
        fixed = [np.flatnonzero(supported)]
        for body, at in zip(bodies, parts.at, strict=True):
            motions = rigid_motions(parts.V[at], body.length)
            motions = motions @ free_motions(parts.V[at], supported[at], body.length, comm)
            self._free.append(motions.reshape(3 * at.size, motions.shape[2]))
            dofs = (3 * at[:, None] + np.arange(3)).reshape(-1)
            fixed.append(dofs[determining(self._free[-1], comm)])
        self._fixed = np.unique(np.concatenate(fixed))
        K.zeroRowsColumns((rows.first + self._fixed).astype(PETSc.IntType), diag=scale)
        self._solver = solver_of(K)

    def strained(self, forces: Sequence[Array]) -> list[Array]:
        """Displacements of their nodes, without a rigid motion that nothing prevents. Collective.

        They, and the forces on the nodes, have the shape (nodes, 3) in the frame of each [m, N].
        Forces are in balance where no support holds the body.
        """
        scene, parts, out = self._scene, self._parts, []
        right = self._right.array.reshape(-1, 3)
        for at, force in zip(parts.at, forces, strict=True):
            right[at] = force
        self._right.array[self._fixed] = 0.0
        self._solver.solve(self._right, self._found)
        u = self._found.array_r.reshape(-1, 3)
        for body, at, motions in zip(self.bodies, parts.at, self._free, strict=True):
            m = np.repeat(scene.averaging_mass[body.nodes], 3)[:, None]
            moved = motions @ fitted_motion(motions, u[at].reshape(-1, 1), scene.sum, m)
            out.append(u[at] - moved.reshape(-1, 3))
        return out

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        free(self._solver, self._right, self._found)


class Carried(NamedTuple):
    """Motion by forces on rigid parts there."""

    u: Array  # displacements of the owned nodes in space, zero outside, shape (nodes, 3) [m]
    cells: Indices  # owned cells that it is of
    # Those of them whose forces balance where it leads to; it is a linear response, the first
    # derivative of a motion, in the others
    balanced: Indices

    def among(self, count: int) -> tuple[Bools, Bools]:
        """Which of so many owned cells it is of, and of which as a linear response."""
        cells, linear = np.zeros((2, count), dtype=bool)
        cells[self.cells] = linear[self.cells] = True
        linear[self.balanced] = False
        return cells, linear


class Recovery:
    """Knows strains of rigid parts; solves for those named rigid once for each state.

    The whole structure's equations and factors serve for as long as the division and its effects
    are the same; factors that have become too old are found out by the rest of a solve.
    """

    def __init__(self, stepper: Stepper, forces: BodyForces, held: HeldParts | None) -> None:
        """Nothing is known yet; held are parts named rigid, None if supports never hold one."""
        self._stepper, self._forces, self._held = stepper, forces, held
        self._asked = -1  # the state that is known, by how often it had been written into
        self._known: Carried | None = None
        self._linear: LinearForms | None = None
        self._rest: dict[bool, AtRest] = {}  # of parts that move, and of those that are held
        self._whole: Whole | None = None
        self._of: tuple[object, ...] = ()  # what that is bound to
        self._ended = False

    def recovered(self) -> Carried:
        """Strains of rigid parts after the last step. Collective."""
        if self._known is None or self._asked != self._stepper.state.changes:
            self._asked, self._known = self._stepper.state.changes, self._recovered()
            if self._ended:
                self._free()
        return self._known

    def _recovered(self) -> Carried:
        stepper, loaded = self._stepper, []
        u = np.zeros((stepper.scene.owned_nodes, 3))
        cells: Indices = np.empty(0, np.int32)
        for held, own in self._loaded().items():
            if not own:
                continue
            bodies = [data for data, _ in own]
            present = self._held.present() if held and self._held else stepper.state.bodies
            R = {id(body.data): body.motion.R for body in present}
            moved = self._at_rest(held, bodies).strained([force for _, force in own])
            for (data, force), e in zip(own, moved, strict=True):
                turned = R[id(data)].T
                u[data.nodes] = e @ turned
                cells = np.union1d(cells, data.cells)
                loaded += [(data, force @ turned)]
        return Carried(u, cells.astype(np.int32), self._balanced(u, loaded))

    def _loaded(self) -> dict[bool, list[tuple[RigidBody, Array]]]:
        """Parts named rigid and ρ in their frames, of those held and of others. Collective."""
        now = {id(data) for data in self._stepper.state.bodies.of.records}
        moving = [(data, force) for data, force in self._forces.named() if id(data) in now]
        return {False: moving, True: [] if self._held is None else self._held.loaded()}

    def _at_rest(self, held: bool, bodies: list[RigidBody]) -> AtRest:
        """The equations of these parts. Collective."""
        known = self._rest.get(held)
        if known is not None and [*map(id, known.bodies)] == [*map(id, bodies)]:
            return known
        if known is not None:
            known.destroy()
        if self._linear is None:
            self._linear = LinearForms(self._stepper.scene, self._stepper.forces)
        mask = self._stepper.system.prescribed.mask.reshape(-1, 3)
        where = self._held.held() if held and self._held is not None else mask
        self._rest[held] = AtRest(self._stepper, self._linear, bodies, where)
        return self._rest[held]

    def _balanced(self, u: Array, loaded: Sequence[tuple[RigidBody, Array]]) -> Indices:
        """Put in strains of parts in the whole structure, where these differ: their owned cells.

        Displacements u of owned nodes, shape (nodes, 3) [m], are written where parts are, which
        come with ρ at their nodes in space, likewise [N]. Collective.
        """
        stepper, parts = self._stepper, [data for data, _ in loaded]
        none = np.empty(0, np.int32)
        if not parts or not small_enough(stepper):
            return none
        if not (self._bends(u, parts) or self._more_bears(parts)):
            return none
        whole = self._present(parts)
        whole.take(self._forces.dt)
        try:
            known = whole.displaced([force for _, force in loaded])
        finally:
            whole.leave()
        if known is None:
            return none
        for data, e in zip(parts, known, strict=True):
            u[data.nodes] = e
        return np.concatenate([data.cells for data in parts])

    def remember(self) -> None:
        """Keep findings of the last step beyond its equations. Collective."""
        if self._held is not None:
            self._held.remember()

    def forget(self) -> None:
        """Forget the last step of held parts, which an error has ended."""
        if self._held is not None:
            self._held.forget()

    def _present(self, parts: Sequence[RigidBody]) -> Whole:
        """The equations of the present division. Collective."""
        system = self._stepper.system
        of = system, system.acting, *parts
        forgetful = bool(self._stepper.state.notes)  # what effects remember goes on meanwhile
        if self._whole is None or forgetful or [*map(id, of)] != [*map(id, self._of)]:
            if self._whole is not None:
                self._whole.destroy()
            self._whole, self._of = Whole(self._stepper, parts), of
        return self._whole

    def _free(self) -> None:
        """Free the PETSc objects. Collective."""
        free(self._whole, *self._rest.values())
        self._whole, self._of, self._rest = None, (), {}

    def destroy(self) -> None:
        """Free the PETSc objects; later requests make their own. Collective."""
        self._free()
        self._ended = True

    def _bends(self, u: Array, parts: Sequence[RigidBody]) -> bool:
        """Whether any of the parts moves far within itself by a linear response. Collective."""
        far = (np.abs(u[data.nodes]).max(initial=0.0) > BENDS * data.length for data in parts)
        return bool(self._stepper.scene.sum(float(sum(far))))

    def _more_bears(self, parts: Sequence[RigidBody]) -> bool:
        """Whether springs, contacts or supports elsewhere take loads as well. Collective."""
        stepper = self._stepper
        active = PrescribedDofs(stepper.scene, stepper.system.prescribed.active).mask
        elsewhere = np.any(active.reshape(-1, 3), axis=1)
        elsewhere &= outside(elsewhere.size, parts)
        here = np.count_nonzero(elsewhere[: stepper.scene.owned_nodes])
        return bool(stepper.system.actions.elastic or stepper.scene.sum(float(here)))
