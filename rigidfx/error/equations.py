"""The error's equation about a shape, over all cells, and its solution while supports last.

K resists all motions of the nodes of a rigid face but the rigid ones. Let R be the six rigid
motions of these nodes, u_a the displacements of a few of them, and q = G u_a the rigid motion that
fits u_a by least squares. The forms

    B u = u - R G u_a

are zero in rigid motions only, and s BᵀB is added to K. B couples each node with these few nodes
only; a projection onto all rigid motions would couple all with all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.base.mesh_order import MeshOrder
from rigidfx.base.remembered import Kind, joined, part_of, restore
from rigidfx.base.types import Array, Bools, Ints
from rigidfx.coupling.mass import ConsistentMass, LumpedMass, Mass
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Preload, Rigid, rigid_faces
from rigidfx.effects.joints.joint import Between
from rigidfx.error.contacts import Contacts, increments_of
from rigidfx.error.frames import Frames, to_space
from rigidfx.error.held import Held
from rigidfx.error.joints import Joints, joined_parts
from rigidfx.error.linear_motion import NAMED, LinearMotion, ground_of
from rigidfx.error.loose import Loose, held_in_part, loose_parts
from rigidfx.error.modal import Modal
from rigidfx.error.reactions import Reactions
from rigidfx.error.response import PREPARING, AllUnknowns, Response
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.rigid_motions import independent, rigid_motions
from rigidfx.scene.scene import Scene
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt
from rigidfx.withheld.parts import mass_of

__all__ = ["LARGEST", "SOLUTION", "Equations"]

Given = tuple[float, float, float]  # length of a step, and its damping: see `Response.step`

# Unknowns up to which e is solved for all of them; beyond, by modes where there are no joints.
LARGEST = 12_000
Int = PETSc.IntType


def stiff_faces(scene: Scene, rows: Rows, places: Array, K: PETSc.Mat, times: float) -> None:
    """Make the nodes of each rigid face resist all but rigid motions. Collective.

    Args:
        scene: The problem.
        rows: Rows of all nodes.
        places: Of the owned nodes in the shape, shape (nodes, 3) [m].
        K: Their stiffness; its pattern grows.
        times: s as a multiple of the mean stiffness on the diagonal of a face's rows.
    """
    for face in rigid_faces(scene.effects):
        nodes = scene.nodes(face.where, face.name, (2,))
        nodes = nodes[nodes < scene.owned_nodes]
        own = (3 * nodes[:, None] + np.arange(3)).reshape(-1)
        diagonal = K.getDiagonal()
        sums = scene.sum([float(diagonal.array_r[own].sum()), float(own.size)])
        diagonal.destroy()
        B = _forms(scene, rows, places[nodes], rows.first + own)
        penalty = B.transposeMatMult(B)
        different = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        K.axpy(times * float(sums[0] / sums[1]), penalty, different)
        B.destroy()
        penalty.destroy()


def _forms(scene: Scene, rows: Rows, places: Array, numbers: Ints) -> PETSc.Mat:
    """B of a face. Collective.

    Args:
        scene: The problem.
        rows: Rows of all nodes.
        places: Of the face's owned nodes, shape (nodes, 3) [m].
        numbers: Of their rows.
    """
    comm = scene.comm
    counts = np.asarray(scene.sum(np.r_[places.sum(axis=0), float(len(places))]))
    arms = places - counts[:3] / counts[3]
    length = float(np.sqrt(scene.sum(float((arms**2).sum())) / counts[3]))
    R = rigid_motions(arms, length).reshape(-1, 6)
    best = np.unique(independent(R) // 3)
    offers = comm.allgather((arms[best], numbers.reshape(-1, 3)[best]))
    all_arms, all_rows = (np.concatenate([offer[k] for offer in offers]) for k in (0, 1))
    modes = rigid_motions(all_arms, length)
    few = np.unique(independent(modes.reshape(-1, 6)) // 3)
    columns, fit = all_rows[few].reshape(-1), np.linalg.pinv(modes[few].reshape(-1, 6))
    B = PETSc.Mat().create(comm)
    B.setSizes([(numbers.size, None), (rows.dofs.size, None)])
    B.setType(PETSc.Mat.Type.AIJ)
    B.setPreallocationNNZ(columns.size + 1)
    first = comm.exscan(numbers.size) or 0
    here = (first + np.arange(numbers.size)).astype(Int)
    if here.size:
        B.setValues(here, columns.astype(Int), -(R @ fit), PETSc.InsertMode.ADD_VALUES)
    for row, column in zip(here, numbers.astype(Int), strict=True):
        B.setValue(row, column, 1.0, PETSc.InsertMode.ADD_VALUES)
    B.assemble()
    return B


class Equations:
    """One set of matrices and its solution; others follow where supports or viscosities change.

    Attributes:
        response: The solution; None before the first step of e.
        loose: Rigid motions that nothing holds; none likewise.
        joints: The joints of the twin; None before the first step of e, and without joints.
        reactions: Forces of the supports; None before the first step of e.
        shape: Displacement that makes the shape [m].
    """

    def __init__(self, stepper: Stepper, sums: Sequence[csr_array]) -> None:
        """Compile the forms. Collective.

        Args:
            stepper: Knows the forces and the supports of the run.
            sums: Sums of e that will be asked for.
        """
        scene = stepper.scene
        self._stepper, self._sums = stepper, sums
        self._forms = LinearForms(scene, stepper.forces)
        few = 3 * scene.space.dofmap.index_map.size_global <= LARGEST
        self._few = few or bool(scene.named(Between))
        self._held = Held(scene)
        self._led: Array | None = None  # increments of e at supports in this step
        self._viscous: list[int] = []  # terms of viscosity in these equations
        self._begun: dict[int, float] = {}  # see `Joints`
        self.response: Response | None = None
        n = scene.owned_nodes
        self.loose = Loose(scene, np.zeros(n, dtype=bool), *np.empty((2, 3 * n, 0)))
        self.joints: Joints | None = None
        self.reactions: Reactions | None = None
        self.shape = self._forms.shape

    def have(self, dt: float, frames: Frames, kick: Array) -> Array:
        """Bind the solution for the supports and viscosities that act. Collective.

        A support that begins holds the twin's nodes where they are: e stays as it is there. Where
        parts turn supports or springs of few directions, the frames get another shape.

        Args:
            dt: Length of the step of the run [s].
            frames: The shape.
            kick: Velocities that e has not taken yet, shape (nodes, 3) [m/s].

        Returns:
            Those that it has not taken now.
        """
        scene, forces = self._stepper.scene, self._stepper.forces
        known, held = self._held, self._stepper.prescribed.mask[: kick.size]
        viscous = [k for k, _ in forces.viscous_terms]
        new = self.response is None or viscous != self._viscous or bool((held != known.mask).any())
        new = scene.comm.allreduce(new, op=MPI.LOR)
        if not new and not known.directed:
            return kick
        x = self._stepper.state.places
        Q = frames.of_parts(x)
        if new or known.turned(Q):
            e, rate = np.zeros((2, *x.shape))
            if self.response is not None:
                e, rate = self.response.fields()
            rate = rate + kick
            self.destroy()
            known.hold(held, to_space(e, Q[frames.part]), frames)
            if known.turned(Q):
                e, rate = (to_space(a, Q[frames.part]) for a in (e, rate))
                frames.begin_at(x)
                self._few = True  # whose first step is not one by new modes
            self._viscous = viscous
            self._make(frames, e, rate)
            if self.joints is not None:
                self.joints.struck()
            forces.set_rate(1 / dt)
            return np.zeros_like(kick)
        return kick

    def _make(self, frames: Frames, e: Array, rate: Array) -> None:
        """Bind the solution for what holds and is viscous, from e and its rate on. Collective."""
        scene, forces = self._stepper.scene, self._stepper.forces
        with PREPARING:
            forces.set_rate(1.0)
            found = about(self._stepper, self._forms, frames, self._held.mask)
        motion, self.loose, joined = found
        own = self._stepper, frames, joined, self._begun
        self.joints = Joints(*own) if scene.named(Between) else None
        e, rate = self.loose.still(e), motion.halted(self.loose.still(rate))
        self.reactions = Reactions(scene, self._stepper.prescribed, motion, frames)
        # Modes take a part that supports hold to be without rigid motions.
        if self._few or held_in_part(scene, frames, self._held.mask):
            self.response = AllUnknowns(motion, e, rate)
        else:
            supported = np.flatnonzero(self._held.mask)
            sums = *self._sums, *self.reactions.sums
            self.response = Modal(scene, motion, supported, self.loose, sums, e, rate)

    @property
    def known(self) -> bool:
        """Whether these equations tell e."""
        return self.response is None or self.response.valid

    @property
    def all_held(self) -> bool:
        """Whether something holds all motions of all parts as a whole."""
        of_joints = 0 if self.joints is None else self.joints.free.shape[1]
        return not self.loose.count + of_joints

    @property
    def unheld(self) -> Bools:
        """Owned nodes of parts that nothing holds, or not all their motions. Collective."""
        return self.loose.nodes if self.joints is None else self.loose.nodes | self.joints.unheld()

    def follow(self, attempt: Attempt, frames: Frames) -> None:
        """Find supports and joints at the end of a step that has been solved. Collective."""
        self._led = None
        if self._held.moves and isinstance(self.response, AllUnknowns):
            x = self._stepper.state.places
            turned = frames.of_parts(x + increments_of(self._stepper, attempt))[frames.part]
            self._led = self._held.increments(*self.response.fields(), attempt.dt, turned)
        if self.joints is not None:
            self.joints.follow(attempt)

    def step(self, force: Array, given: Given) -> None:
        """Advance e by a step that joints hold. Collective.

        Args:
            force: Mean force, shape (nodes, 3) [N].
            given: Length of the step [s], and the damping: see `Response.step`.
        """
        response = self.response
        assert response is not None
        start = None if self.joints is None else response.fields()
        if isinstance(response, AllUnknowns):
            response.step(force, *given, self._led)
            if self.joints is not None and start is not None:
                self.joints.close(response, start, given)
        else:
            response.step(force, *given)

    def press(self, contacts: Contacts, force: Array, given: Given, Q: Array, number: int) -> None:
        """Advance e by a step while contacts are closed, joints or not. Collective.

        Args:
            contacts: Contacts of the twin.
            force: See `step`.
            given: See `step`.
            Q: Rotation of each owned node's part, shape (nodes, 3, 3).
            number: Number of the step.
        """
        response = self.response
        assert response is not None
        kept, start = response.kept(), response.fields()[0]

        def step(more: Array) -> Array:
            response.restore(kept)
            self.step(force + more, given)
            return response.fields()[0]

        contacts.solved(start, step, (response, *given, self.joints and number), Q)

    def struck(self, lost: Array) -> None:
        """Record an impact, in which the twin's parts named rigid do as those of the run.

        Args:
            lost: Velocities that it takes out, shape (nodes, 3) [m/s]; set to zero at such parts.
        """
        named = {part.where for part in self._stepper.scene.named(Rigid)}
        for body in self._stepper.state.bodies.of.records:
            if body.is_face or body.name in named:
                lost[body.nodes] = 0.0
        if self.joints is not None:
            self.joints.struck()

    def scale(self, part: float) -> None:
        """Scale e, to zero in free parts without bodies and let-down. Collective."""
        assert self.response is not None
        left: Array = np.full(self._stepper.scene.owned_nodes, part)
        eased = self._stepper.system.actions.easing
        if not self.all_held and not eased and not len(self._stepper.state.bodies):
            left[self.unheld] = 0.0
        self.response.scale(left)
        if self._stepper.scene.comm.allreduce(bool((left < 1).any()), op=MPI.LOR):
            self._begun.clear()  # motors hold e from now on where it is now
            self._held.values = left[:, None] * self._held.values

    def resume(self, frames: Frames, known: Mapping[str, Any], order: MeshOrder) -> None:
        """Bind the solution that a checkpoint knows. Collective.

        Args:
            frames: The shape.
            known: Of `SOLUTION`.
            order: Numbers of this rank's cells and nodes.
        """
        restore(self._held, known["held"], order)
        self._held.look(frames)
        self._viscous, self._begun, self._few = known["same"]
        self._make(frames, *np.zeros((2, *frames.shape.shape)))
        restore(self.response, known["response"], order)

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        if self.response is not None:
            self.response.destroy()
            self.response = None


class _Solution(Kind):
    """The solution of the error's equation, of the `ErrorMotion` that has it; None before it is."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        if value.response is None:
            return None
        same = value._viscous, dict(value._begun), value._few
        return part_of(value._held, order), same, part_of(value.response, order)

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        if value.response is None:
            return None
        held, same, responses = zip(*parts, strict=True)
        return {
            "held": joined(value._held, held, orders),
            "same": same[0],
            "response": joined(value.response, responses, orders),
        }

    def set(self, owner: Any, name: str, whole: Any, order: MeshOrder) -> None:
        if whole is not None:
            getattr(owner, name).resume(owner._frames, whole, order)


SOLUTION = _Solution()


def about(
    stepper: Stepper, forms: LinearForms, frames: Frames, held: Bools
) -> tuple[LinearMotion, Loose, Loose]:
    """M, C and K of all cells about a shape, with springs; rigid parts and faces stiff. Collective.

    Args:
        stepper: Knows the forces of the run.
        forms: Linear forms, which get the shape.
        frames: The shape.
        held: Which owned dofs supports hold.

    Returns:
        The equations, the rigid motions that nothing holds, and those that only joints do.
    """
    places = frames.shape
    scene, forces, shape = stepper.scene, stepper.forces, forms.shape.x
    rows = Rows(scene.space, np.arange(len(places), dtype=np.int32))
    owned = scene.mesh.topology.index_map(scene.mesh.topology.dim).size_local
    cells = forces.cells(np.arange(owned, dtype=np.int32))
    shape.array[: places.size] = (places - stepper.state.X[: len(places)]).reshape(-1)
    shape.scatter_forward()
    mass, ground = mass_of(scene, rows, cells, carried=True), ground_of(scene, rows)
    named = [scene.owned_cells(part.where, part.kind) for part in scene.named(Rigid)]
    rigid = forces.cells(np.unique(np.concatenate(named)).astype(np.int32)) if named else None
    supported = np.flatnonzero(held)
    more, stressed = _given_masses(stepper, rows), bool(scene.named(Preload))
    motion = LinearMotion(rows, cells, forms, mass, supported, ground, rigid, more, stressed)
    stiff_faces(scene, rows, places, motion.matrices[0], NAMED)
    joined = joined_parts(scene)
    loose, held_by_joints = (
        loose_parts(scene, frames, held, ground, motion.matrices[1], among)
        for among in (~joined, joined)
    )
    return motion, loose, held_by_joints


def _given_masses(stepper: Stepper, rows: Rows) -> list[PETSc.Mat]:
    """Masses to add for parts of given mass, one matrix each; the caller destroys them. Collective.

    The given mass replaces that of the part's cells, or lumped that of all its nodes, and is spread
    alike. A given inertia is not used.
    """
    scene, out = stepper.scene, []
    for part in scene.named(Rigid):
        if part.mass is not None:
            cells = scene.owned_cells(part.where, part.kind)
            own = scene.cell_weights(scene.density(), cells)[: scene.owned_nodes]
            mass: Mass
            if scene.mass == "lumped":
                own = np.where(own > 0, scene.nodal_mass[: own.size], 0.0)
                mass = LumpedMass(rows, own)
            else:
                mass = ConsistentMass(scene, rows, stepper.forces.cells(cells))
            out.append(mass.matrix())
            out[-1].scale(float(part.mass) / float(scene.sum(own.sum())) - 1)
            mass.destroy()
    return out
