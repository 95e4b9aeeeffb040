"""The bodies of a run that were found: their shapes, and how far these hold.

A body begins with the modes that Δt resolves, as a resonance that builds up cannot be seen in the
forces of one step. Its cells wake where it spins too fast between joints (`spun_joints`), and where
it bends so far that its energy is not that of second order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.log import tell
from rigidfx.base.remembered import ON_DOFS, ON_NODES, Each, Remembered, same
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.coupling.dof_layout import AtNodes
from rigidfx.effects import rigid_faces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, RigidBody
from rigidfx.mechanics.rigid_motions import best_motion
from rigidfx.scene.scene import Scene
from rigidfx.shapes.found import Found
from rigidfx.shapes.interface import Interface
from rigidfx.shapes.linear import Linear
from rigidfx.shapes.responses import Responses
from rigidfx.shapes.shortening import About
from rigidfx.step.stepper import Stepper
from rigidfx.switch.inventory import about_start
from rigidfx.switch.spun_joints import SpinLimits, off_by
from rigidfx.withheld.body_forces import BodyForces
from rigidfx.withheld.fields import Fields, Force

# Part of a body's length below which ν of its motion is that of rounding.
ROUNDING = float(np.sqrt(np.finfo(np.float64).eps))


@dataclass(frozen=True)
class BendControl:
    """Numbers of the check of ν, from runs of demos/benchmarks/waking.py beside flexible twins.

    Attributes:
        nonlinear: Part of ½ q·Ωq by which the energy of a body may differ from its expansion. A
            frequency is off by ¾ of it: 0.003 is one swing of an arm at 1 %.
        doubled: Factor of ½ q·Ωq after which that is looked at again.
        least: Part of the largest ½ q·Ωq so far below which it is not.
        share: Part of the largest miss of any node, by mass, above which cells wake.
    """

    nonlinear: float = 0.003
    doubled: float = 2.0
    least: float = 1e-6
    share: float = 0.3


@dataclass(frozen=True)
class Known:
    """What is known of a body since it was frozen.

    Attributes:
        begun: How many modes it began with.
        lacking: The lowest ω that these lack [1/s].
        spin: Its angular velocity then, in its frame [rad/s].
        energy: ½ q·Ωq when ν was looked at [J].
    """

    begun: int
    lacking: float
    spin: Array
    energy: float


class FoundBodies:
    """The bodies that were found, with shapes by a structure's responses about its start.

    `destroy` frees the PETSc objects.

    Attributes:
        known: What is known of each body, by its number.
        bends: Largest displacement by which shapes err as bodies bend, so far [m].
    """

    remembered: ClassVar[Remembered] = same("bends", "_largest", "_modes", "_cut") | {
        "known": Each(Known),
        "_start": ON_DOFS,
        "_vectors": ON_NODES,
    }

    def __init__(self, stepper: Stepper, forces: BodyForces, dt: float) -> None:
        """None is found: the present state is the start; dt is the nominal Δt [s]."""
        self._stepper, self._forces, self._dt, self._scene = stepper, forces, dt, stepper.scene
        self.control = BendControl()
        self.known: dict[int, Known] = {}
        self.bends, self._largest = 0.0, 0.0  # strain energy of any body so far
        self._start: Array = stepper.state.u.x.array[: 3 * self._scene.owned_nodes].copy()
        self._linear: Linear | None = None
        self._matrices: dict[int, tuple[RigidBody, Found, Array, Interface]] = {}  # by number
        self._modes, self._cut = 0, np.inf  # modes of the whole, and the lowest ω that these lack
        self._vectors: Array = np.zeros((self._scene.owned_nodes, 3, 0))  # modes, and further ones
        self._limits = SpinLimits(self._scene)

    def linear(self) -> Linear:
        """Equations of the whole about its start. Collective."""
        if self._linear is None:
            stepper, scene = self._stepper, self._scene
            acting = stepper.system.acting
            responses = about_start(scene, stepper.forces, self._start, acting)
            self._linear = Linear(responses)
            if not self._vectors.shape[2]:
                self._vectors, self._cut = self._linear.modes(self._forces.dt or self._dt)
                self._modes = self._vectors.shape[2]
                tell(scene.comm, f"bodies begin with {self._modes} modes of the whole")
        return self._linear

    @property
    def responses(self) -> Responses:
        """Static responses of the whole about its start. Collective."""
        return self.linear().responses

    @staticmethod
    def grows(data: RigidBody) -> bool:
        """Whether a body is one that was found, not named."""
        return not data.named and not data.is_face and not data.given

    def _of(self, data: RigidBody) -> tuple[Found, Array]:
        """A body's matrices, and its rotation from the start to the freeze. Collective."""
        known = self._matrices.get(data.number)
        if known is None or not np.array_equal(known[0].origin, data.origin):
            if known is not None:
                self._drop(data.number)
            stiffness = self.responses.stiffness
            found = Found(self._scene, self._stepper.forces, stiffness.linear, data)
            frozen = self._stepper.state.X[data.nodes] + data.displacement
            Q, _ = best_motion(stiffness.places[data.nodes], frozen, self._scene.sum)
            beside = Interface(stiffness, found.cells, data.nodes)
            self._matrices[data.number] = known = data, found, Q, beside
        return known[1], known[2]

    def _drop(self, number: int) -> None:
        """Free the matrices of a body. Collective."""
        _, found, _, beside = self._matrices.pop(number)
        found.destroy()
        beside.destroy()

    def about(self, body: Body) -> About | None:
        """The expansion of a body; None of one that is named. Collective."""
        if not self.grows(body.data):
            return None
        return About(self.responses, *self._of(body.data))

    # Shapes ---------------------------------------------------------------------------------------

    def shaped(self, body: Body) -> Body:
        """A body that was frozen just now with its shapes. Collective."""
        data = body.data
        if not self.grows(data):
            return body
        self.linear()  # finds the modes of the whole
        found, vectors = self._within(data, self._vectors)
        self._limits.forget(data.number)
        begun, lacking = self._modes, self._cut
        whole = data.size == self._scene.mesh.topology.index_map(3).size_global
        # Its own modes are those of the whole, or would bend rigid faces.
        if np.isfinite(self._cut) and not (whole or self.stiff(data)):
            own, lacking = found.modes(self._forces.dt or self._dt, self._cut)
            begun += own.shape[2]
            vectors = np.concatenate([vectors, own], axis=2)
        self.known[data.number] = Known(begun, lacking, body.motion.angular_velocity_body, 0.0)
        made = found.with_shapes(body, vectors)
        return body if made is None else found.moving(made)

    def stiff(self, data: RigidBody) -> bool:
        """Whether a body has nodes of rigid faces. Collective."""
        faces = rigid_faces(self._scene.effects)
        nodes = [self._scene.nodes(face.where, face.name, (2,)) for face in faces]
        return bool(self._scene.sum(sum(np.isin(data.nodes, own).sum() for own in nodes)) > 0)

    def _within(self, data: RigidBody, e: Array) -> tuple[Found, Array]:
        """A body's matrices, and a response in its frame. Collective."""
        found, Q = self._of(data)
        return found, np.einsum("ab,nbk->nak", Q, e[data.nodes])

    def more(self, body: Body, vectors: Array) -> Body | None:
        """A body with further shapes; None if it has all of them. Collective."""
        found, own = self._within(body.data, vectors)
        return found.with_shapes(body, own, vectors.shape[2] - 1)

    def shortened(self, body: Body) -> Array:
        """δ of the whole structure as a body bends, in space, (owned nodes, 3) [m]. Collective."""
        found, Q = self._of(body.data)
        F = np.zeros((self._scene.owned_nodes, 3, 1))
        if body.data.shapes is not None:
            F[body.data.nodes, :, 0] = found.even(body.data.shapes.bent(body.motion.q)) @ Q
        return np.asarray(-self.responses.solve(F)[:, :, 0] @ (body.motion.R @ Q).T)

    def keep(self, vector: Array) -> None:
        """Give a shape, (owned nodes, 3, 1), to bodies that will be found."""
        self._vectors = np.concatenate([self._vectors, vector], axis=2)

    def moved(self, body: Body) -> Array:
        """Displacement of a body's nodes from the start, shape (nodes, 3) [m]."""
        return np.asarray(body.displacement - self._start.reshape(-1, 3)[body.data.nodes])

    def frequency(self, data: RigidBody, e: Array) -> float:
        """ω of a body by Rayleigh's quotient of a static response [1/s]. Collective."""
        found, own = self._within(data, e)
        own = found.unmoved(own)
        stiff = found.dot(own, found.times_stiffness(own))[0, 0]
        heavy = found.dot(own, found.times_mass(own))[0, 0]
        return float(np.sqrt(max(stiff, 0.0) / heavy)) if heavy > 0 else np.inf

    def at_start(self, forces: Sequence[tuple[Fields, Force]]) -> Array:
        """Forces on bodies as they turn back to the start, shape (owned nodes, 3) [N]."""
        F = np.zeros((self._scene.owned_nodes, 3))
        for fields, force in forces:
            _, Q = self._of(fields.data)
            F[force.nodes] = fields.at_nodes(force) @ Q
        return F

    # How far they hold ----------------------------------------------------------------------------

    def spun(self, bodies: Bodies) -> Bools | None:
        """Cells of bodies that forces of joints stiffen as they spin; None if none. Collective."""
        woken = np.zeros(self._scene.mesh.topology.index_map(3).size_local, dtype=bool)
        fast = False
        for body in (own for own in bodies if self.grows(own.data)):
            limit = self._limits.limit(body, self.known[body.data.number].spin)
            if limit is not None:
                fast, woken[body.data.cells] = True, True
                words = f"forces of joints stiffen it above {limit:.3g} rad/s"
                tell(self._scene.comm, f"{body.data.name} spins too fast for its shapes: {words}")
        return woken if fast else None

    def bent(self, bodies: Bodies, allowed: float) -> Bools | None:
        """Cells in which the energy is not that of second order; None if none are. Collective.

        Displacements may err by what is allowed [m]. The motion of a body that cells beside it hold
        errs as a whole, that of others as they bend.
        """
        control, comm = self.control, self._scene.comm
        for body in bodies:
            data, shapes, q = body.data, body.data.shapes, body.motion.q
            if shapes is None or not self.grows(data):
                continue
            energy, known = 0.5 * float(q @ shapes.stiffness @ q), self.known[data.number]
            self._largest = max(self._largest, energy, data.frozen.strain)
            least = max(control.least * self._largest, control.doubled * known.energy)
            if np.abs(q).max() <= ROUNDING * data.length or energy <= least:
                continue
            self.known[data.number] = replace(known, energy=energy)
            found, Q = self._of(data)
            d = shapes.bent(q)
            w = found.whole(d, self.responses.of_nodes(data.nodes, Q))
            missed = found.missed(d, w)
            beside = self._matrices[data.number][3]
            nu = abs(float(self._scene.sum(missed.sum()))) + beside.energy(d @ Q) / found.energy(d)
            errs = self.moved(body) if beside.holds else d
            size = comm.allreduce(float(np.abs(errs).max(initial=0.0)), op=MPI.MAX)
            if nu <= control.nonlinear and off_by(nu) * size <= allowed:
                self.bends = max(self.bends, off_by(nu) * size)
                continue
            dense = np.abs(missed) / self._scene.averaging_mass[data.nodes]
            most = comm.allreduce(float(dense.max(initial=0.0)), op=MPI.MAX)
            marks = np.zeros(self._scene.owned_nodes)
            marks[data.nodes] = dense > control.share * most
            tell(comm, f"{data.name} bends by more than its shapes follow: ν = {nu:.3g}")
            woken = np.zeros(self._scene.mesh.topology.index_map(3).size_local, dtype=bool)
            woken[data.cells] = at_cells(self._scene, marks, data.cells) > 0
            return woken
        return None

    def bind(self) -> None:
        """Forget bodies that are no more. Collective."""
        numbers = {body.number for body in self._stepper.state.bodies.of.records}
        self.known = {number: own for number, own in self.known.items() if number in numbers}
        for number in sorted(self._matrices.keys() - numbers):
            self._drop(number)
            self._limits.forget(number)

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for number in [*self._matrices]:
            self._drop(number)
        if self._linear is not None:
            self._linear.destroy()
            self._linear.responses.destroy()
        self._linear = None


def at_cells(scene: Scene, values: Array, cells: Indices) -> Array:
    """The largest of values at owned nodes in each of some owned cells. Collective."""
    at = AtNodes(scene).of_owners(values)[scene.space.dofmap.list[cells]]
    return np.asarray(at.max(axis=1, initial=0.0))
