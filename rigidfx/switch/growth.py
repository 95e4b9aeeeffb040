"""Bodies that were found and get shapes as forces call for them.

ρ⊥, the forces on a body's nodes less what it and its shapes do, is what the body still withholds.
In each step the static response of the whole structure to it, e = K⁺ρ⊥, is compared with the
tolerance: where

    min(ω, 2/Δt) ε(e) > tol ,    ω² = e·K e/e·M e  of the body,

in a cell, e becomes a shape of the body, and the step is made again. A shape begins undeformed and
at rest, so that it vibrates about e with the amplitude e: these are the strain rates to which it
comes; 2/Δt is the highest frequency of steps. Cells wake where a body goes on calling for shapes. A
body begins with the modes that Δt resolves, as a resonance that builds up cannot be seen in the
forces of one step.

Where a displacement is bounded in place of a strain rate, 2 |e| of each node is compared with a
part of the largest displacement up to the end of the step, or of the largest e that has become a
shape: that is the motion to come where a load begins. While a motion begins from rest, a body grows
once in a step and no cell wakes, as all steps err by much of nothing then. And e has its followers
beside it (`rigidfx.shapes.ritz`); with strain rates these would let a body follow a wave for which
its cells are to wake.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from rigidfx.base.log import tell
from rigidfx.base.remembered import ON_DOFS, ON_NODES, PART, Remembered, same
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.decide.limits import Limits, part_of
from rigidfx.effects import rigid_faces
from rigidfx.flexible.strain_rate import CellStrains, Indicator
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, RigidBody
from rigidfx.mechanics.rigid_motions import best_motion
from rigidfx.shapes.found import Found
from rigidfx.shapes.linear import Linear
from rigidfx.shapes.ritz import DEPTH, RESOLVED, ritz
from rigidfx.shapes.shortening import About
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt, Watch
from rigidfx.switch.growth_control import GrowthControl
from rigidfx.switch.inventory import about_start
from rigidfx.switch.resonance import Resonance
from rigidfx.switch.spun_joints import SpinLimits, off_by
from rigidfx.withheld.body_forces import BodyForces
from rigidfx.withheld.fields import Fields, Force
from rigidfx.withheld.fields import size as size_of

OUTGROWN = "forces strain them otherwise than their shapes can"
# Part of a body's length below which ν of its motion is that of rounding.
ROUNDING = float(np.sqrt(np.finfo(np.float64).eps))


@dataclass(frozen=True)
class Looked:
    """What an attempt calls for.

    Attributes:
        bodies: All bodies, some with more shapes, with which the step is to be made again.
        woken: Owned cells that wake; None where none does.
        reason: Why they wake, in words.
    """

    bodies: Bodies | None = None
    woken: Bools | None = None
    reason: str = OUTGROWN


class Growth(Watch):
    """The shapes of bodies that were found; `destroy` frees its PETSc objects."""

    remembered: ClassVar[Remembered] = same(
        "_ratio",
        "_asked",
        "_since",
        "_energies",
        "_largest",
        "_modes",
        "_cut",
        "_lacking",
        "_begun",
        "_swing",
        "_spins",
        "_foreseen",
        "_lacks",
        "_bends",
    ) | {
        "_resonance": PART,
        "_start": ON_DOFS,
        "_vectors": ON_NODES,
    }

    def __init__(
        self, stepper: Stepper, forces: BodyForces, indicator: Indicator, dt: float
    ) -> None:
        """Nothing has grown: the present state is the start, about which the structure responds.

        An indicator of its own measures strains; dt is the nominal Δt [s].
        """
        self._stepper, self._forces, self._dt = stepper, forces, dt
        scene, self.control = stepper.scene, GrowthControl()
        self._scene = scene
        self._strains = CellStrains(scene, stepper.forces, indicator)
        self._start: Array = stepper.state.u.x.array[: 3 * scene.owned_nodes].copy()
        self._linear: Linear | None = None
        self._found: dict[int, tuple[RigidBody, Found, Array]] = {}  # by number
        self._modes = 0
        self._cut = np.inf  # the lowest ω that modes of the whole lack [1/s]
        self._lacking: dict[int, float] = {}  # that which each body lacks
        self._begun: dict[int, int] = {}  # modes that each has
        self._resonance, self._swing = Resonance(scene, self.control), np.inf
        self._vectors: Array = np.zeros((scene.owned_nodes, 3, 0))  # modes, and what has grown
        self._withheld: list[tuple[Fields, Force]] = []  # ρ⊥ as last seen
        self._ratio, self._since = np.inf, 0
        self._asked = np.inf  # size of the forces of that ratio
        self._reached = 0.0  # largest displacement of bodies at the end of a step [m]
        self._foreseen = 0.0  # largest static response that has become a shape [m]
        self._lacks, self._bends = 0.0, 0.0  # largest 2 |e|, and error of shapes by ν, so far [m]
        self._added: dict[int, tuple[float, ...]] = {}  # what called for shapes in this step
        self._energies: dict[int, float] = {}  # ½ q·Ωq of each body at the last look
        self._largest = 0.0  # strain energy of any body so far
        self._limits = SpinLimits(scene)
        self._spins: dict[int, Array] = {}  # of each body when it was frozen, in its frame
        self._stiff: Bools = np.zeros(scene.owned_nodes, dtype=bool)  # nodes of rigid faces
        for face in rigid_faces(scene.effects):
            nodes = scene.nodes(face.where, face.name, (2,))
            self._stiff[nodes[nodes < scene.owned_nodes]] = True

    # The whole ------------------------------------------------------------------------------------

    def _bound(self) -> Linear:
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

    @staticmethod
    def _grows(data: RigidBody) -> bool:
        """Whether a body is one that was found, not named."""
        return not data.named and not data.is_face and not data.given

    def _of(self, data: RigidBody) -> tuple[Found, Array]:
        """A body's matrices, and its rotation from the start to the freeze. Collective."""
        known = self._found.get(data.number)
        if known is None or not np.array_equal(known[0].origin, data.origin):
            if known is not None:
                known[1].destroy()
            stiffness = self._bound().responses.stiffness
            found = Found(self._scene, self._stepper.forces, stiffness.linear, data)
            frozen = self._stepper.state.X[data.nodes] + data.displacement
            Q, _ = best_motion(stiffness.places[data.nodes], frozen, self._scene.sum)
            self._found[data.number] = known = data, found, Q
        return known[1], known[2]

    def about(self, body: Body) -> About | None:
        """The expansion of a body; None of one that is named. Collective."""
        if not self._grows(body.data):
            return None
        found, Q = self._of(body.data)
        return About(self._bound().responses, found, Q)

    def shaped(self, body: Body) -> Body:
        """A body that was frozen just now with its shapes. Collective."""
        if not self._grows(body.data):
            return body
        found, Q = self._of(body.data)
        number, vectors = body.data.number, self._vectors[body.data.nodes]
        self._energies.pop(number, None)  # q begins at zero
        self._limits.forget(number)
        self._spins[number] = body.motion.angular_velocity_body
        vectors = np.einsum("ab,nbk->nak", Q, vectors)
        self._begun[number], self._lacking[number] = self._modes, self._cut
        stiff = self._scene.sum(np.count_nonzero(self._stiff[body.data.nodes])) > 0
        whole = body.data.size == self._scene.mesh.topology.index_map(3).size_global
        # Its own modes are those of the whole, or would bend rigid faces.
        if np.isfinite(self._cut) and not (stiff or whole):
            own, self._lacking[number] = found.modes(self._forces.dt or self._dt, self._cut)
            self._begun[number] += own.shape[2]
            vectors = np.concatenate([vectors, own], axis=2)
        made = found.with_shapes(body, vectors)
        return body if made is None else found.moving(made)

    # A step ---------------------------------------------------------------------------------------

    def look(self, attempt: Attempt, limits: Callable[[], Limits] | None = None) -> Looked:
        """What an attempt that was solved calls for. Collective.

        Limits are those that wake cells; without them nothing may change any more.
        """
        self._forces.bear(attempt.t, attempt.dt)
        if not self._forces.borne:
            return Looked()
        for too_far in (self._spun, self._bent) if limits is not None else ():
            if (looked := too_far(attempt)) is not None:
                return looked
        own = [each for each in self._forces.borne.values() if self._grows(each[0].data)]
        self._withheld = [(fields, fields.outside(force)) for fields, force in own]
        size = size_of(self._scene, self._withheld)
        known = self._since + 1 < self.control.every and not self._added
        grown = max(1.0, size / self._asked)  # other forces: so may the ratio have
        quiet = known and size * self._ratio * grown < self.control.gate
        if limits is None or not size > 0:
            return Looked()
        if (woken := self._resonant(attempt.dt, limits)) is not None:
            return Looked(woken=woken, reason="motions that their shapes lack may be in resonance")
        if quiet:
            return Looked()
        now = limits()
        if now.rates is None:
            self._reached = self._reach(attempt)
        return self._judged(attempt.dt, self._at_start(self._withheld), size, now)

    def _at_start(self, forces: Sequence[tuple[Fields, Force]]) -> Array:
        """Forces on bodies as they turn back to the start, shape (owned nodes, 3) [N]."""
        F = np.zeros((self._scene.owned_nodes, 3))
        for fields, force in forces:
            _, Q = self._of(fields.data)
            F[force.nodes] = fields.at_nodes(force) @ Q
        return F

    def _reach(self, attempt: Attempt) -> float:
        """Largest displacement of bodies at the end of a step. Collective."""
        start, here = self._start.reshape(-1, 3), 0.0
        for body in attempt.increments.end:
            moved = body.displacement - start[body.data.nodes]
            here = max(here, float(np.linalg.norm(moved, axis=1).max(initial=0.0)))
        return self._scene.comm.allreduce(here, op=MPI.MAX)

    def _resonant(self, dt: float, limits: Callable[[], Limits]) -> Bools | None:
        """Cells of bodies that lack a mode which may be in resonance. Collective."""
        control = self.control
        known = [(fields, self._resonance.momenta(fields)) for fields, _ in self._lacks_modes()]
        momenta = [(fields, s) for fields, s in known if s is not None]
        size = size_of(self._scene, momenta) / dt if momenta else 0.0
        if not size * min(self._ratio, self._swing) > control.gate * control.wakes:
            return None
        G = self._at_start([(fields, fields.outside(s)) for fields, s in momenta])
        cells = np.concatenate([fields.data.cells for fields, _ in momenta])
        lowest = min(self._lacking[fields.data.number] for fields, _ in momenta)
        moved: Array = self._bound().step(np.asarray(G[:, :, None] / dt), dt)[:, :, 0]
        owned = self._scene.mesh.topology.index_map(3).size_local
        amplitude = np.asarray(moved * (2 / dt / lowest))
        rates = self._part(amplitude, np.full(owned, lowest), cells, limits())
        most = self._scene.comm.allreduce(float(rates.max(initial=0.0)), op=MPI.MAX)
        self._swing = most / size
        if not most > control.wakes:
            return None
        tell(self._scene.comm, f"modes that bodies lack may be in resonance: {most:.3g} tol")
        return np.asarray(rates > control.woken)

    def _spun(self, attempt: Attempt) -> Looked | None:
        """Cells of bodies that forces of joints stiffen as they spin; None if none. Collective."""
        woken = np.zeros(self._scene.mesh.topology.index_map(3).size_local, dtype=bool)
        fast = False
        for body in (own for own in attempt.increments.end if self._grows(own.data)):
            limit = self._limits.limit(body, self._spins[body.data.number])
            if limit is not None:
                fast, woken[body.data.cells] = True, True
                words = f"forces of joints stiffen it above {limit:.3g} rad/s"
                tell(self._scene.comm, f"{body.data.name} spins too fast for its shapes: {words}")
        return Looked(woken=woken, reason="they spin too fast for their shapes") if fast else None

    def _bent(self, attempt: Attempt) -> Looked | None:
        """Cells in which the energy is not that of second order; None if none are. Collective."""
        known, control, comm = self._energies, self.control, self._scene.comm
        for body in attempt.increments.end:
            shapes, q, number = body.data.shapes, body.motion.q, body.data.number
            if shapes is None or not self._grows(body.data):
                continue
            energy = 0.5 * float(q @ shapes.stiffness @ q)
            self._largest = max(self._largest, energy, body.data.frozen.strain)
            if np.abs(q).max() <= ROUNDING * body.data.length:
                continue
            before = known.get(number, 0.0)
            if energy <= max(control.least * self._largest, control.doubled * before):
                continue
            known[number] = energy
            found, Q = self._of(body.data)
            d = shapes.bent(q)
            respond = self._bound().responses.of_nodes(body.data.nodes, Q)
            missed = found.missed(d, respond)
            nu = abs(float(self._scene.sum(missed.sum())))
            if nu <= control.nonlinear:
                size = comm.allreduce(float(np.abs(d).max(initial=0.0)), op=MPI.MAX)
                self._bends = max(self._bends, off_by(nu) * size)
                continue
            dense = np.abs(missed) / self._scene.averaging_mass[body.data.nodes]
            most = comm.allreduce(float(dense.max(initial=0.0)), op=MPI.MAX)
            marks = np.zeros(self._scene.owned_nodes, dtype=bool)
            marks[body.data.nodes] = dense > control.share * most
            tell(comm, f"{body.data.name} bends by more than its shapes follow: ν = {nu:.3g}")
            bent = self._with_nodes(marks, body.data.cells)
            return Looked(woken=bent, reason="they bend by more than their shapes follow")
        return None

    def _with_nodes(self, marks: Bools, cells: Indices) -> Bools:
        """Those of some owned cells that have a marked node. Collective."""
        owned = self._scene.mesh.topology.index_map(3).size_local
        out: Bools = np.zeros(owned, dtype=bool)
        out[cells] = self._at_cells(marks.astype(float), cells) > 0
        return out

    def _lacks_modes(self) -> list[tuple[Fields, Force]]:
        """ρ⊥ of the bodies that lack modes which Δt resolves."""
        own = self._withheld
        return [each for each in own if np.isfinite(self._lacking[each[0].data.number])]

    def _growing(self) -> list[Body]:
        return [body for body in self._stepper.state.bodies if self._grows(body.data)]

    def _judged(self, dt: float, F: Array, size: float, limits: Limits) -> Looked:
        """Compare responses with limits. Collective."""
        comm, control = self._scene.comm, self.control
        growing = {body.data.number: body.data for body in self._growing()}
        cells = np.concatenate([data.cells for data in growing.values()])
        e = self._bound().responses.solve(F[:, :, None])
        omega = np.zeros(self._scene.mesh.topology.index_map(3).size_local)
        for data in growing.values() if limits.rates is not None else ():
            omega[data.cells] = min(self._frequency(data, e), 2 / dt)
        rates = self._part(e[:, :, 0], omega, cells, limits)
        most = comm.allreduce(float(rates.max(initial=0.0)), op=MPI.MAX)
        self._ratio, self._asked, self._swing, self._since = most / size, size, np.inf, 0
        if not most > 1:
            return self._left(most, limits)
        above = np.array([rates[data.cells].max(initial=0.0) for data in growing.values()])
        comm.Allreduce(MPI.IN_PLACE, above, op=MPI.MAX)
        wanted = dict(zip(growing, above, strict=True))
        new: Array | None = None  # found where a body has room for it
        out, ended, grown = list(self._stepper.state.bodies), [], False
        for k, body in enumerate(out):
            want = wanted.get(body.data.number, 0.0)
            if not want > 1:
                continue
            count = body.data.deforms_by - self._begun[body.data.number]
            before = self._added.get(body.data.number, ())
            if limits.begins and before:  # what is left is for the next step to tell
                continue
            stalls, more = len(before) > 1 and want > max(control.wakes, 0.5 * before[-2]), None
            if not (stalls or count >= control.grown):
                new = self._followed(F, dt, limits) if new is None else new
                more = self._more(body, new)
            if more is None or new is None:
                if not limits.begins and (want > control.wakes or count >= control.grown):
                    ended.append(body.data)
                continue
            out[k], grown = more, True
            self._added[body.data.number] = (*before, float(want))
            self._vectors = np.concatenate([self._vectors, new[:, :, :1]], axis=2)
            tell(comm, f"{body.data.name} has {more.data.deforms_by} shapes: {want:.3g} tol")
        if ended:
            cells = np.concatenate([data.cells for data in ended])
            return Looked(woken=self._strained_most(e[:, :, 0], rates, cells, limits))
        if not grown:
            return self._left(most, limits)
        size = float(np.linalg.norm(e, axis=1).max(initial=0.0))
        self._foreseen = max(self._foreseen, comm.allreduce(size, op=MPI.MAX))
        return Looked(Bodies.of_each(out))

    def _left(self, most: float, limits: Limits) -> Looked:
        """Keep what bodies lack in a step that calls for nothing, over that allowed."""
        if limits.rates is None:
            self._lacks = max(self._lacks, most * self._allowed(limits))
        return Looked()

    def _frequency(self, data: RigidBody, e: Array) -> float:
        """ω of a body by Rayleigh's quotient of a static response [1/s]. Collective."""
        found, own = self._within(data, e)
        own = found.unmoved(own)
        stiff = found.dot(own, found.times_stiffness(own))[0, 0]
        heavy = found.dot(own, found.times_mass(own))[0, 0]
        return float(np.sqrt(max(stiff, 0.0) / heavy)) if heavy > 0 else np.inf

    def _part(self, motion: Array, omega: Array, cells: Indices, limits: Limits) -> Array:
        """Strain rates, or displacements, by a vibration over those allowed, by owned cells.

        Its amplitude is at the owned nodes [m], its frequency in owned cells [1/s]. Cells that are
        not asked for have zero.
        """
        out = np.zeros(omega.size)
        if limits.rates is None:
            out[cells] = 2 * self._at_cells(np.linalg.norm(motion, axis=1), cells)
            return part_of(out, np.full(out.size, self._allowed(limits)))
        shape = self._bound().responses.stiffness.linear.shape
        out[cells] = omega[cells] * self._strains.of(motion, 1.0, shape, cells)
        return part_of(out, limits.rates)

    def _strained_most(self, e: Array, rates: Array, cells: Indices, limits: Limits) -> Bools:
        """Those of some owned cells that wake: above a limit, or strained most. Collective."""
        woken: Bools = np.zeros(rates.size, dtype=bool)
        if limits.rates is not None:
            woken[cells] = rates[cells] > self.control.woken
            return woken
        shape = self._bound().responses.stiffness.linear.shape
        strains = self._strains.of(e, 1.0, shape, cells)
        here = float(strains.max(initial=0.0))
        most = self._scene.comm.allreduce(here, op=MPI.MAX)
        woken[cells] = strains > self.control.share * most
        return woken

    def _allowed(self, limits: Limits) -> float:
        """Displacement that bodies may lack, of the largest up to the end of a step [m]."""
        return max(limits.size, limits.part * max(self._foreseen, self._reached))

    def _at_cells(self, values: Array, cells: Indices) -> Array:
        """The largest of values at owned nodes in each of some owned cells. Collective."""
        field = fem.Function(self._scene.space)
        field.x.array.reshape(-1, 3)[: values.size] = values[:, None]
        field.x.scatter_forward()
        at = field.x.array.reshape(-1, 3)[:, 0][self._scene.space.dofmap.list[cells]]
        return np.asarray(at.max(axis=1, initial=0.0))

    def _followed(self, F: Array, dt: float, limits: Limits) -> Array:
        """The static response to forces, and its followers where e is bounded. Collective."""
        resolved, depth = dt / RESOLVED, DEPTH if limits.rates is None else 1
        vectors, count = ritz(self._bound().responses, (F[:, :, None], depth), resolved=resolved)
        return vectors[:, :, :count]

    def _within(self, data: RigidBody, e: Array) -> tuple[Found, Array]:
        """A body's matrices, and a response in its frame. Collective."""
        found, Q = self._of(data)
        return found, np.einsum("ab,nbk->nak", Q, e[data.nodes])

    def _more(self, body: Body, vectors: Array) -> Body | None:
        """A body with further shapes; None if it has all of them. Collective."""
        found, own = self._within(body.data, vectors)
        return found.with_shapes(body, own, vectors.shape[2] - 1)

    # What is left --------------------------------------------------------------------------------

    def size(self) -> float:
        """Largest displacement that bodies have lacked so far, but in cells that wake [m]."""
        return self._lacks + self._bends

    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        self._resonance.advance(self._lacks_modes(), self._lacking, attempt.dt)
        self._added = {}
        self._since += 1

    def bind(self, flexible: object) -> None:
        """See `Watch`; forgets bodies that are no more."""
        numbers = {body.number for body in self._stepper.state.bodies.of.records}
        self._withheld = [own for own in self._withheld if own[0].data.number in numbers]
        for number in [k for k in self._found if k not in numbers]:
            self._found.pop(number)[1].destroy()
            self._energies.pop(number, None)
            self._lacking.pop(number, None)
            self._begun.pop(number, None)
            self._spins.pop(number, None)
            self._limits.forget(number)

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for _, found, _ in self._found.values():
            found.destroy()
        if self._linear is not None:
            self._linear.destroy()
            self._linear.responses.destroy()
        self._found, self._linear = {}, None
