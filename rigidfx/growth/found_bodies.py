"""The bodies of a run that were found: their shapes, and how far these hold.

docs/theory/shapes.md#withheld-forces has how they begin and how they leave their shapes. One that
tension stiffens gets Γ, and cells wake where it bends so far that its energy is not that of its
shapes (`bends`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, NamedTuple

import numpy as np

from rigidfx.base.log import tell
from rigidfx.base.remembered import ON_CELLS, ON_DOFS, ON_NODES, PART, Each, Remembered, same
from rigidfx.base.types import Array, Bools, Ints
from rigidfx.coupling.rows import Rows
from rigidfx.effects import rigid_faces
from rigidfx.effects.nodes import Instant
from rigidfx.flexible.kernels import integral
from rigidfx.growth.closed_joints import ClosedJoints, Moved
from rigidfx.inventory.inventory import about_start
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, RigidBody
from rigidfx.mechanics.rigid_motions import best_motion
from rigidfx.mechanics.rotation import axial
from rigidfx.shapes import bends
from rigidfx.shapes.excess import About, Excess, deformed
from rigidfx.shapes.found import Found
from rigidfx.shapes.linear import Linear
from rigidfx.shapes.orthonormal import largest
from rigidfx.shapes.part import MOST
from rigidfx.shapes.pressing import Pressing
from rigidfx.shapes.responses import Responses
from rigidfx.shapes.ritz import CLEAN
from rigidfx.step.equations.actions import Actions, apart
from rigidfx.step.stepper import Stepper
from rigidfx.withheld.body_forces import BodyForces
from rigidfx.withheld.fields import Fields, Force


class Shift(NamedTuple):
    """How nodes move, and what all but the bodies gain by that."""

    d: Array  # of the owned nodes, beside their bodies' own motion, shape (nodes, 3) [m]
    bodies: Bodies  # all bodies of the state, which keep velocities in their own frames
    energy: float  # of flexible cells, springs and contacts [J]
    angular_momentum: Array  # of nodes of flexible cells and of bodies, shape (3,) [kg m²/s]


@dataclass(frozen=True)
class Looked:
    """What an attempt calls for."""

    # All bodies, some with more shapes, with which the step is to be made again
    bodies: Bodies | None = None
    woken: Bools | None = None  # owned cells that wake; None where none does
    reason: str = ""  # why they wake, in words


@dataclass(frozen=True)
class Known:
    """What is known of a body since it was frozen."""

    begun: int  # how many modes it began with
    lacking: float  # the lowest ω that these lack [1/s]
    pressed: int  # how many shapes it has for nodes that press


class FoundBodies:
    """The bodies that were found, with shapes by a structure's responses about its start.

    `destroy` frees the PETSc objects.

    Attributes:
        known: What is known of each body, by its number.
        bends: Largest displacement by which shapes err as bodies bend, so far [m].
        nu: ν of each body when it was looked at, by its name.
        vectors: Modes of the whole, and further shapes, shape (owned nodes, 3, n).
    """

    remembered: ClassVar[Remembered] = same("bends", "nu", "_modes", "_cut") | {
        "known": Each(Known),
        "_looks": PART,
        "_pressing": PART,
        "_start": ON_DOFS,
        "vectors": ON_NODES,
        "_left": ON_CELLS,
    }

    def __init__(self, stepper: Stepper, forces: BodyForces, dt: float) -> None:
        """None is found: the present state is the start; dt is the nominal Δt [s]."""
        self._stepper, self._forces, self._dt, self._scene = stepper, forces, dt, stepper.scene
        self.known: dict[int, Known] = {}
        self.bends, self._looks = 0.0, bends.Looks()
        self.nu: dict[str, float] = {}
        self._start: Array = stepper.state.u.x.array[: 3 * self._scene.owned_nodes].copy()
        self._linear: Linear | None = None
        self._expanded: dict[int, tuple[RigidBody, Found, About]] = {}  # by number
        self._modes, self._cut = 0, np.inf  # modes of the whole, and the lowest ω that these lack
        self.vectors: Array = np.zeros((self._scene.owned_nodes, 3, 0))
        self._pressing = Pressing(self._scene)
        self._taut: set[int] = set()  # bodies that have got Γ in this step
        self._cells = self._scene.mesh.topology.index_map(3).size_local  # owned ones
        # Cells of bodies that lost some as they bent, in the last step and in this one
        self._left, self._leaving = np.zeros((2, self._cells), dtype=bool)

    def linear(self) -> Linear:
        """Equations of the whole about its start, or the mesh if that is not stable. Collective."""
        if self._linear is None:
            stepper, scene = self._stepper, self._scene
            acting = stepper.system.acting
            responses = about_start(scene, stepper.forces, self._start, acting)
            if scene.sum(np.count_nonzero(self._start)) and not responses.stable:
                responses.destroy()  # stresses of an `InitialDisplacement`, say, that nothing bears
                self._start = np.zeros_like(self._start)
                responses = about_start(scene, stepper.forces, self._start, acting)
                tell(scene.comm, "bodies respond about the mesh, as the start is not stable")
            self._linear = Linear(responses)
            if not self.vectors.shape[2]:
                self.vectors, self._cut = self._linear.modes(self._forces.dt or self._dt)
                self._modes = self.vectors.shape[2]
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

    def _of(self, data: RigidBody) -> tuple[Found, About]:
        """A body's matrices, and its expansion. Collective."""
        known = self._expanded.get(data.number)
        if known is None or not np.array_equal(known[0].origin, data.origin):
            if known is not None:
                known[2].destroy()
            responses = self.responses
            stiffness = responses.stiffness
            found = Found(self._scene, self._stepper.forces, stiffness.linear, data)
            frozen = self._stepper.state.X[data.nodes] + data.displacement
            Q, _ = best_motion(stiffness.places[data.nodes], frozen, self._scene.sum)
            self._expanded[data.number] = known = data, found, About(responses, found, Q)
        return known[1:]

    def about(self, body: Body) -> About | None:
        """The expansion of a body; None of one that is named. Collective."""
        return self._of(body.data)[1] if self.grows(body.data) else None

    # Shapes ---------------------------------------------------------------------------------------

    def shaped(self, body: Body) -> Body:
        """A body that was frozen just now with its shapes. Collective."""
        data = body.data
        if not self.grows(data):
            return body
        self.linear()  # finds the modes of the whole
        found, vectors = self._within(data, self.vectors)
        own, of_all = (largest(self._scene.comm, u) for u in (vectors, self.vectors))
        some: Bools = own > CLEAN * of_all  # others are rounding in this body
        vectors = vectors[:, :, some]
        self._looks.forget(data.number)
        self._pressing.forget()
        self.nu.pop(data.name, None)
        begun, lacking = int(np.count_nonzero(some[: self._modes])), self._cut
        whole = data.size == self._scene.mesh.topology.index_map(3).size_global
        # Its own modes are those of the whole, or would bend rigid faces.
        if np.isfinite(self._cut) and not (whole or self.stiff(data)):
            own, lacking = found.modes(self._forces.dt or self._dt, self._cut)
            begun += own.shape[2]
            vectors = np.concatenate([vectors, own], axis=2)
        self.known[data.number] = Known(begun, lacking, 0)
        made = found.with_shapes(body, vectors)
        return body if made is None else found.moving(made)

    def stiff(self, data: RigidBody) -> bool:
        """Whether a body has nodes of rigid faces. Collective."""
        faces = rigid_faces(self._scene.effects)
        nodes = [self._scene.nodes(face.where, face.name, (2,)) for face in faces]
        return bool(self._scene.sum(sum(np.isin(data.nodes, own).sum() for own in nodes)) > 0)

    def _within(self, data: RigidBody, e: Array) -> tuple[Found, Array]:
        """A body's matrices, and a response in its frame. Collective."""
        found, about = self._of(data)
        return found, np.einsum("ab,nbk->nak", about.Q, e[data.nodes])

    def more(self, body: Body, vectors: Array, loads: int = 1) -> Body | None:
        """A body with further shapes; None if it has all of them. Collective.

        Vectors after the first ones, those of loads, are followers.
        """
        found, own = self._within(body.data, vectors)
        return found.with_shapes(body, own, vectors.shape[2] - loads)

    def pressed(
        self, bodies: Bodies, pressing: tuple[Ints, Array], dt: float, wakes: bool
    ) -> Looked | None:
        """What nodes that press for the first time call for; None if nothing. Collective.

        Contacts press owned nodes in directions, see `ContactForces`; shapes follow frequencies of
        a step of dt [s]. If bodies have no room for more, cells at these nodes wake, or none.
        """
        new = self._pressing.new(pressing)
        if new is None:
            return None
        before, now, known = list(bodies), [], dict(self.known)
        full = np.zeros(self._cells, dtype=bool)
        marks: Array = np.zeros(self._scene.owned_nodes)
        marks[new[0]] = 1.0
        for body in before:
            more, fits = self._with_more(body, new, dt)
            now.append(more)
            if wakes and not fits:
                full[body.data.cells] = bends.at_cells(self._scene, marks, body.data.cells) > 0
        if self._scene.sum(np.count_nonzero(full)):
            self._pressing.forget()  # the bodies that are then ask anew
            self.known = known
            return Looked(woken=full, reason="contacts press more of them than shapes follow")
        changed = any(own is not body for own, body in zip(now, before, strict=True))
        return Looked(Bodies.of_each(now)) if changed else None

    def _with_more(self, body: Body, new: tuple[Ints, Array], dt: float) -> tuple[Body, bool]:
        """A body with shapes for nodes that press, and whether it has room for all. Collective."""
        data, stiffness = body.data, np.eye(0)
        modes: Array = np.zeros((len(data.nodes), 3, 0))
        if not self.grows(data):
            return body, True
        about, known = self._of(data)[1], self.known[data.number]
        if data.shapes is not None:
            modes, stiffness = data.shapes.modes.swapaxes(1, 2), data.shapes.stiffness
        room, R = max(MOST - known.pressed, 0), body.motion.R @ about.Q
        found, fits = self._pressing.vectors(about, R, new, (modes, stiffness), dt, room)
        for vectors, count in found:
            body = self.more(body, vectors, count) or body
        if grown := body.data.deforms_by - data.deforms_by:
            self.known[data.number] = replace(known, pressed=known.pressed + grown)
            text = f"{data.name} has {body.data.deforms_by} shapes, {grown} for nodes that press"
            tell(self._scene.comm, text)
        return body, fits

    def shortened(self, body: Body) -> Array:
        """δ of the whole structure as a body bends, in space, (owned nodes, 3) [m]. Collective."""
        (found, about), shapes = self._of(body.data), body.data.shapes
        F, by = np.zeros((self._scene.owned_nodes, 3, 1)), np.zeros(body.data.offsets.shape)
        if shapes is not None:
            e, _ = body.stretched
            even = found.even(shapes.bent(e))
            F[body.data.nodes, :, 0] = found.beyond(shapes, even) @ about.Q
            if shapes.tension is not None:
                q, K = np.array(shapes.shorter), shapes.tightened(body.motion.q)
                n = len(shapes.tension)
                q[:n] += np.linalg.solve(K[:n, :n], found.left_on(shapes, e, even)[:n])
                by = shapes.bent(q) @ body.motion.R.T
        out = np.asarray(-self.responses.solve(F)[:, :, 0] @ (body.motion.R @ about.Q).T)
        out[body.data.nodes] -= by
        return out

    def kept(self, e: Array) -> Array:
        """A response, (nodes, 3) [m], as springs of joints hold it: `ClosedJoints`. Collective.

        Where none has a spring, inertia alone balances rigid motions, as it
        does in K⁺: a slider-crank whose rod and block were kept woke, for no smaller error.
        """
        stepper, state = self._stepper, self._stepper.state
        linkage = stepper.system.linkage
        if linkage is None or not linkage.drives.stiffness().any():
            return e
        state.rebuild()
        own = {body.data.number for body in state.bodies if self.grows(body.data)}
        joints = ClosedJoints(self._scene, state, own, stepper.system.acting, self.responses)
        return joints.kept(e)

    def keep(self, vector: Array) -> None:
        """Give a shape, (owned nodes, 3, 1), to bodies that will be found."""
        self.vectors = np.concatenate([self.vectors, vector], axis=2)

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
            F[force.nodes] = fields.at_nodes(force) @ self._of(fields.data)[1].Q
        return F

    def grown(self, data: RigidBody) -> int:
        """How many shapes forces have called for, beside those that it began with."""
        known = self.known[data.number]
        return data.deforms_by - known.begun - known.pressed

    # How far they hold ----------------------------------------------------------------------------

    def bent(
        self,
        bodies: Bodies,
        allowed: float | None,
        withheld: Sequence[tuple[Fields, Force]] | None,
        pull: float,
    ) -> Looked | None:
        """Cells whose energy is not that of shapes, or bodies with more; None if none. Collective.

        Displacements may err by what is allowed [m], or by a part of themselves if that is None, as
        nothing bounds them yet. A body of which cells have woken in the last step wakes as a whole:
        a device that fell on its corner lost some in each of twenty steps, and rebounded by 13 %
        less. The motion of a body that cells join to supports errs as a whole,
        that of others as they bend. Forces that are withheld, of the size `pull` [N/√kg], stiffen
        bodies, and so do their own stresses; they are None where cells wake instead.
        """
        for body in bodies:
            data = body.data
            if not (self.grows(data) and self._looks.due(body, pull)):
                continue
            _, about = self._of(data)
            found, grown = Excess(about, body), bends.NEAR
            nu = found.nu
            errs = self.moved(body) if about.on_supports else about.beside.apart(found.d @ about.Q)
            far = about.part.largest(errs)
            size = bends.off_by(nu) * far
            bound = bends.BOUND if allowed is None or about.on_supports else bends.FARTHEST
            small = nu <= bound and (allowed is None or size <= allowed)
            if (withheld is not None or found.drawn.any()) and data.number not in self._taut:
                own = [each for each in withheld or () if each[0].data is data]
                if (more := self._tensed(body, own, allowed, found.drawn)) is not None:
                    self._taut.add(data.number)
                    return Looked(more)
            if size > 0 and allowed is not None:  # 3 ν |d| goes with |d|³
                grown = min(bends.NEAR, max(allowed / size, 1.0) ** (2 / 3))
            self._looks.looked(body, grown, pull)
            self.nu[data.name] = nu
            if small:
                self.bends = max(self.bends, size)
                continue
            words = "bends by more than its shapes follow"
            tell(self._scene.comm, f"{data.name} {words}: ν = {nu:.3g}")
            woken: Bools = np.zeros(self._cells, dtype=bool)
            cells = found.most(bends.SHARE)
            again = self._scene.sum(np.count_nonzero(self._left[data.cells])) > 0
            woken[data.cells if again or not self._scene.sum(cells.size) else cells] = True
            self._leaving[data.cells] = True
            return Looked(woken=woken, reason="they bend by more than their shapes follow")
        return None

    def _tensed(
        self,
        body: Body,
        withheld: Sequence[tuple[Fields, Force]],
        allowed: float | None,
        drawn: Array,
    ) -> Bodies | None:
        """The bodies, one with Γ of its shapes, and with one more for a tension that these lack.

        Joints and springs may stretch it by what is drawn, (m,) [m]. None if it needs none of
        both, where it comes in a step. Collective.
        """
        part, now = self._of(body.data)[0], list(self._stepper.state.bodies)
        (k,) = (k for k, own in enumerate(now) if own.data.number == body.data.number)
        e = self.at_start(withheld)[:, :, None]
        e = self.responses.solve(e) if withheld else e
        d, out = self._within(body.data, e)[1][:, :, 0], now[k]
        lacks = bends.lacks_tension(body)
        sooner = bends.AGAIN if drawn.any() else 1.0  # joints lose the work until then
        most = d + bends.stresses(body) + sooner * deformed(body, drawn)
        if lacks and not bends.tightens(body, part, most):
            return None
        bound, few = None if drawn.any() else allowed, self.grown(body.data) < MOST
        if withheld and few and bends.tightens(body, part, sooner * d, bound):
            out = self.more(out, e) or out
        if out is now[k] and not lacks:
            return None
        now[k] = bends.tense(out, part, 0 if lacks else body.data.deforms_by)
        tell(
            self._scene.comm,
            f"{body.data.name}: tension stiffens its {len(now[k].motion.q)} shapes",
        )
        return Bodies.of_each(now)

    def accept(self) -> None:
        """A step has been accepted: bodies may get Γ, or a shape for tension, once more."""
        self._taut.clear()
        self._left, self._leaving = self._leaving, np.zeros(self._cells, dtype=bool)

    # Where they leave their shapes ----------------------------------------------------------------

    def shift(self, bodies: Sequence[Body]) -> Shift | None:
        """How nodes move as bodies of the state leave their shapes; None if not. Collective."""
        stepper, own = self._stepper, [body for body in bodies if self.grows(body.data)]
        if not own:
            return None
        scene, state, system = self._scene, stepper.state, stepper.system
        d = np.sum([self.shortened(body) for body in own], axis=0)
        leaving = {body.data.number for body in bodies}
        for body in state.bodies:
            if body.data.number not in leaving:
                d[body.data.nodes] = 0.0
        d.reshape(-1)[system.prescribed.mask] = 0.0  # supports may have begun since
        state.rebuild()
        closed: Callable[[Array], Moved | None] = partial(Moved, bodies=state.bodies, energy=0.0)
        if system.linkage is not None:
            closed = ClosedJoints(scene, state, leaving, system.acting, self.responses).moved
        rows = Rows(scene.space, np.arange(len(d), dtype=np.int32))
        surface, u = stepper.forces.surface, state.u.x.array
        actions = apart(scene, rows, u, surface, system.acting)
        gained = partial(self._gained, bodies=bodies, rows=rows, actions=actions)
        moved = closed(d)
        found, stay, go = (None, 0.0, 0.0) if moved is None else gained(moved)
        (a, at), (b, to) = (0.0, stay), (1.0, go)
        for _ in range(2 if stay * go < 0 else 0):  # between both it is that of the expansion
            way = a + (b - a) * at / (at - to)
            if (moved := closed(way * d)) is not None:
                found, _, go = gained(moved)
                (a, at), (b, to) = ((way, go), (b, to)) if go * to < 0 else ((a, at), (way, go))
        actions.destroy()
        return found if abs(go) < abs(stay) else None

    def _gained(
        self, moved: Moved, bodies: Sequence[Body], rows: Rows, actions: Actions
    ) -> tuple[Shift, float, float]:
        """The shift of all nodes, and the excess of energy if they stay and if they go [J].

        Actions are those on all nodes. Collective.
        """
        state, forces, none = self._stepper.state, self._stepper.forces, Bodies.of_each(())
        cells = np.sort(np.concatenate([body.data.cells for body in bodies]))
        strain, u = forces.bind_energy(forces.cells(cells)), state.u.x.array

        def further() -> list[float]:
            stored = np.sum(actions.stored(Instant(none, u[rows.dofs], state.t)))
            return [float(stored), integral(strain)]

        before, after = self._stepper.system.energies.both(state, moved.d, further)
        more, wanted = after - before, float(Bodies.of_each(bodies).strain_of_each.sum())
        gained, turned = more[0] + more[4] + moved.energy, more[1:4]
        d = moved.d.copy()
        for was, now in zip(state.bodies, moved.bodies, strict=True):
            d[was.data.nodes] -= now.displacement - was.displacement
        turned += _turned(moved.bodies) - _turned(state.bodies)
        found = Shift(d, moved.bodies, gained, turned)
        return found, before[5] - wanted, after[5] + gained - wanted

    def bind(self) -> None:
        """Forget bodies that are no more. Collective."""
        numbers = {body.number for body in self._stepper.state.bodies.of.records}
        self.known = {number: own for number, own in self.known.items() if number in numbers}
        for number in sorted(self._expanded.keys() - numbers):
            self._expanded.pop(number)[2].destroy()
            self._looks.forget(number)

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for _, _, about in self._expanded.values():
            about.destroy()
        self._expanded.clear()
        if self._linear is not None:
            self._linear.destroy()
            self._linear.responses.destroy()
        self._linear = None


def _turned(bodies: Bodies) -> Array:
    """Angular momentum of bodies about the origin, shape (3,) [kg m²/s]."""
    return np.asarray(axial(bodies.r.T @ bodies.momentum) + bodies.angular_momentum.sum(axis=0))
