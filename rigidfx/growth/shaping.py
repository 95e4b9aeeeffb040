"""Give parts that are named `Reduced` their shapes, and more of them when new forces call for some.

Shapes are static responses of the whole structure about its start, restricted to the part
(`rigidfx.shapes`). What a shape does not change stays as it is: a shape that is added begins at
q = q̇ = 0, so that neither places nor momenta nor energy jump.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.log import tell
from rigidfx.base.matrices import free
from rigidfx.base.remembered import ON_DOFS, ON_NODES, PART, Remembered
from rigidfx.base.types import Array, Ints
from rigidfx.base.warning import warn
from rigidfx.coupling.dof_layout import nodes_of
from rigidfx.effects import Contact, Reduced, Windowed
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.growth.loosening import Loosening
from rigidfx.inventory.inventory import about_start
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import NOTHING, Body, RigidBody
from rigidfx.mechanics.shapes import Shapes
from rigidfx.scene.scene import Scene
from rigidfx.shapes.bends import SOFTEST, Spent, stresses, tense
from rigidfx.shapes.excess import About, stacked, unrelieved
from rigidfx.shapes.faces import of_faces
from rigidfx.shapes.motion import pulled
from rigidfx.shapes.orthonormal import Basis, to_one
from rigidfx.shapes.part import MOST, Part, PartShapes
from rigidfx.shapes.patterns import patterns
from rigidfx.shapes.pressing import Pressing
from rigidfx.shapes.responses import LACKING, Responses
from rigidfx.shapes.ritz import RESOLVED, shapes_of
from rigidfx.shapes.samples import interleaved
from rigidfx.state import State
from rigidfx.step.equations.division import Hold
from rigidfx.step.system.held_bodies import guided

# Square of a spin over that of the lowest frequency, above which spin stiffens: frequencies are
# off by half of it without.
STIFFENING = 1e-4
# Responses to pulls in a row: a string at 30 times its buckling load, pushed aside, errs by 16 %
# without, by 1.8 % with two; a column at 0.91 of it by 22 and 0.9 %.
PULLS = 2
MEGA = 1e6


class Shaping:
    """The shapes of the parts of a run that are named `Reduced`; `destroy` frees the factor.

    Attributes:
        start: Displacement of the owned dofs at the start, about which the structure responds [m];
            None before a part has been given shapes.
        spent: How far the shapes hold.
    """

    remembered: ClassVar[Remembered] = {
        "start": ON_DOFS,
        "_pressing": PART,
        "spent": PART,
        "_loose": ON_NODES,
    }

    def __init__(
        self,
        scene: Scene,
        forces: InternalForces,
        acting: Sequence[Windowed],
        until: float,
        dt: float,
    ) -> None:
        """Nothing is computed; shapes follow frequencies of the shortest step until the end [s]."""
        self._scene, self._forces, self._acting, self._until = scene, forces, acting, until
        self._dt = dt
        self.start: Array | None = None
        self._pressing = Pressing(scene)
        self._loose = np.zeros(scene.owned_nodes, dtype=bool)  # nodes of cells that left parts
        self._responses: Responses | None = None
        self._loads: dict[str, Array] = {}  # patterns of forces from the start on, of each part
        self._expanded: dict[str, tuple[Part, About]] = {}
        self._full: set[str] = set()  # parts that have been warned of
        self.spent = Spent(scene, self.about)
        self._unasked = {e.name for e in scene.named(Reduced) if e.shapes is None}
        self._growing = self._unasked if scene.named(Contact) else set()

    def _bind(self) -> Responses:
        """Responses of the structure about its start, with one factor for a run. Collective."""
        if self._responses is None:
            assert self.start is not None  # parts have been given shapes
            known = self._scene, self._forces, self.start, self._acting
            self._responses = about_start(*known)
        return self._responses

    def shaped(self, state: State, effect: Reduced, body: Body, hold: Hold | None) -> Body:
        """A body that an effect names, frozen just now, with its shapes. Collective.

        The shapes take over what they can of the nodes' velocities, which the state has up to date.
        They have no momenta beside rigid motions, so that those of the body stay. Where supports
        hold it, shapes are zero, but those that follow guides; it moves as these do: see
        `HeldBodies.moving`. If it cannot have as many shapes, or buckles, it is a SceneError on
        every rank.
        """
        if self.start is None:
            self.start = state.u.x.array[: 3 * self._scene.owned_nodes].copy()
        responses, count = self._bind(), effect.shapes
        name = body.data.name
        if name not in self._loads:
            self._loads[name] = patterns(responses, state, self._until, hold)
        part, loads = self._part(body.data), self._loads[name]
        springs = interleaved(responses, [responses.stiffness.of_springs(responses.rigid.all)])
        others = count, springs, of_faces(responses), self._dt / RESOLVED
        found = shapes_of(part, responses, loads, *others)
        held, guides = hold is not None, self._guides(body.data, hold)
        # What contacts call for begins from a part that is held.
        if len(found.force) < (int(held) if count is None else count):
            both = np.concatenate([loads, self._of_spins()], axis=2)
            found = shapes_of(part, responses, both, *others)
        spins = bool(len(found.force)) and self._spins(body, found)
        if spins and count is None:
            stretches = responses.solve(self._of_spins())
            basis = part.begun(found.modes)
            part.extend(basis, stretches, stretches.shape[2])
            found = part.projected(self._with_new(found.modes, basis, found.modes.shape[2]))
        if count is not None and len(found.force) < count:
            raise SceneError(
                f"{effect.owner}: shapes={count} are more than can be told apart in it, which are "
                f"{len(found.force)}. Ask for fewer, or refine its mesh."
            )
        if not len(found.force):
            return body
        given = guides.shape[2]
        if given:
            found = part.projected(np.concatenate([guides, found.modes], axis=2))
        m, nodes = len(found.force), int(self._scene.sum(body.data.nodes.size))
        memory = found.modes.itemsize * 3 * m * nodes / MEGA
        text = f"{effect.owner}: {m} shapes of {nodes} nodes, which take {memory:.1f} MB"
        tell(self._scene.comm, text)
        made = self._with(body, found, held, given)
        made = tense(made, part) if spins else made
        v = state.v.x.array.reshape(-1, 3)[body.data.nodes]
        v = v - body.motion.velocities(body.data.offsets)
        assert made.data.shapes is not None
        return Body(made.data, replace(made.motion, q_rate=part.rates(made.data.shapes, v)))

    def _guides(self, data: RigidBody, hold: Hold | None) -> Array:
        """Static responses of the whole to unit motions of guides, at a body's nodes. Collective.

        There are none where a support clamps a `Rigid` part in it.

        Raises:
            SceneError: On every rank, if a support holds a `Rigid` part in it beside another one.
        """
        none = np.zeros((data.nodes.size, 3, 0))
        if hold is None:
            return none
        responses, scene = self._responses, self._scene
        assert responses is not None
        stiffness = responses.stiffness
        clamped = (stiffness.held & ~stiffness.prescribed.mask).reshape(-1, 3)[data.nodes]
        if scene.sum(np.count_nonzero(clamped)):
            if not hold.guides:
                return none
            raise SceneError(
                f"Reduced '{data.name}': a support clamps a Rigid part in it, and another one "
                "holds it, too. Take the Rigid away, or leave a layer of flexible cells."
            )
        offsets = stiffness.places - data.origin
        each = [motions for _, motions, _ in guided(scene, hold, data, offsets)]
        if not each:
            return none
        moved = np.concatenate(each, axis=2)
        return (moved + responses.solve(pulled(responses, moved)))[data.nodes]

    def _spins(self, body: Body, part: PartShapes) -> bool:
        """Whether a body spins fast enough for its shapes to be stiffer by that. Collective."""
        own = self._part(body.data)
        mass = own.dot(part.modes, own.times_mass(part.modes))
        lowest = float((np.diag(part.stiffness) / np.diag(mass)).min())
        spin = float(body.motion.angular_velocity @ body.motion.angular_velocity)
        return spin > STIFFENING * lowest

    def _of_spins(self) -> Array:
        """The inertia of homogeneous deformations, as spins have it. Collective."""
        assert self._responses is not None
        x = self._responses.stiffness.places
        fields = [np.outer(x[:, i], e) for i in range(3) for e in np.eye(3)[i:]]
        more = self._responses.inertia(np.stack(fields, axis=2))
        return self._responses.balanced(more)

    def _with_new(self, modes: Array, basis: Basis, known: int) -> Array:
        """Shapes, (nodes, 3, m), and those that a basis has beside known ones. Collective."""
        more, _ = to_one(self._scene.comm, basis.vectors[:, :, known:])
        return np.concatenate([modes, more], axis=2)

    def _with(self, body: Body, part: PartShapes, held: bool, given: int) -> Body:
        """A body with other shapes, of which the first ones are those that it has. Collective.

        All are zero where a support holds its frame, and the first ones that are given follow
        supports.
        """
        data, own, drift = body.data, self._part(body.data), None
        modes = part.modes
        if held:
            drift = np.asarray(self._scene.sum(own.times_mass(modes).sum(axis=0)).T) / data.mass
            modes = modes - drift.T
        moments, fields = own.moments(data.offsets, modes), modes.swapaxes(1, 2).copy()
        known = data.nodes, fields, moments, part.stiffness, part.force
        tension = None if data.shapes is None else data.shapes.tension
        selves = None if data.shapes is None else data.shapes.selves
        made = body.with_shapes(Shapes(*known, drift, tension, given=given, selves=selves))
        kept = replace(NOTHING, strain=made.data.frozen.strain)
        return Body(replace(made.data, frozen=kept), made.motion)

    def _part(self, data: RigidBody) -> Part:
        """Stiffness and mass of a part, once responses are bound. Collective."""
        if data.name not in self._expanded:
            assert self._responses is not None
            cells = self._forces.cells(data.cells)
            self._expand(Part(self._responses, cells, data.nodes, data.name), data.name)
        return self._expanded[data.name][0]

    def _expand(self, part: Part, name: str) -> None:
        """Keep the matrices of a part in place of those that it had. Collective."""
        if name in self._expanded:
            self._expanded[name][1].destroy()
        assert self._responses is not None
        self._expanded[name] = part, About(self._responses, part, np.eye(3))

    # Growing --------------------------------------------------------------------------------------

    @property
    def grows(self) -> bool:
        """Whether parts may get more shapes as the run goes on."""
        return bool(self._growing)

    def grown(self, state: State, pressing: tuple[Ints, Array], dt: float) -> Bodies | None:
        """The bodies with shapes for nodes that press for the first time; None if none get any.

        Contacts press owned nodes in directions of the shape (nodes, 3, 3), see `ContactForces`;
        shapes follow frequencies of a step of dt [s]. Collective.
        """
        new = self._pressing.new(pressing)
        if new is None:
            return None
        self._bind()
        before = list(state.bodies)
        now = [self._with_more(body, new, dt) for body in before]
        changed = any(own is not body for own, body in zip(now, before, strict=True))
        return Bodies.of_each(now) if changed else None

    def loosened(self, state: State) -> Bodies | None:
        """The bodies without cells that contacts press too far; None if none leave. Collective."""
        leaving = self.spent.leaving
        if not self._growing or not self._scene.sum(np.count_nonzero(leaving)):
            return None
        state.rebuild()
        out, loosening = [], Loosening(self._scene, self._forces, self._bind())
        for body in state.bodies:
            cells = body.data.cells[leaving[body.data.cells]]
            if not self._scene.sum(cells.size):
                out.append(body)
                continue
            made, part = loosening.without(state, body, cells)
            out.append(made)
            self._expand(part, body.data.name)
            self.spent.left(body.data.number)
            left = nodes_of(self._scene, self._forces.cells(cells))
            self._loose |= left[: self._scene.owned_nodes]
            text = f"{body.data.size - made.data.size} cells that a contact presses leave it"
            tell(self._scene.comm, f"Reduced '{body.data.name}': {text}")
        leaving[:] = False
        return Bodies.of_each(out)

    def _with_more(self, body: Body, new: tuple[Ints, Array], dt: float) -> Body:
        """A body with shapes for nodes that press, as far as its own lack some. Collective."""
        data = body.data
        if data.name not in self._growing:
            return body
        part = self._part(data)
        about, known = self._expanded[data.name][1], part.projected(_free(data))
        m, own = len(known.force), (known.modes, known.stiffness)
        # Those of a part that has lost cells have a rigid motion, which is none of new shapes.
        basis = part.begun(part.still(known.modes))
        room = max(MOST - m, 0)
        found, fits = self._pressing.vectors(about, body.motion.R, new, own, dt, room)
        for vectors, count in found:
            part.extend(basis, vectors, count)
        self._tell_more(data.name, m, len(basis), fits)
        return self._extended(body, part, basis, m)

    def _extended(self, body: Body, part: Part, basis: Basis, m: int) -> Body:
        """A body with the shapes that a basis has beside m known ones. Collective."""
        data = body.data
        if len(basis) == m:
            return body
        every = self._with_new(whole_modes(data).swapaxes(1, 2), basis, m)
        shapes, projected = data.shapes, part.projected(every)
        if shapes is None:
            return self._with(body, projected, False, 0)
        return self._with(body, projected, shapes.drift is not None, shapes.given)

    def tensed(self, bodies: Bodies, at: Bodies, taut: frozenset[str]) -> Bodies:
        """The bodies, some with Γ, by their names, and with shapes for pulls. Collective."""
        some = {body.data.name: body for body in at if body.data.name in taut & self._unasked}
        each = [self._pulled(b, some[b.data.name]) if b.data.name in some else b for b in bodies]
        return self.spent.tense(Bodies.of_each(each), taut)

    def _pulled(self, body: Body, at: Body) -> Body:
        """A body with responses to forces by which stresses of it elsewhere pull. Collective."""
        part, about = self._part(body.data), self.about(body)
        responses, known = about.responses, part.projected(_free(body.data))
        basis, m = part.begun(part.still(known.modes)), len(known.force)
        soft = np.argsort(np.diag(known.stiffness), kind="stable")[:SOFTEST]
        fields = known.modes[:, :, soft]
        shapes = body.data.shapes
        if shapes is not None and shapes.selves is None and self.spent.withholds(at):
            forces, away = stacked(unrelieved(about, shapes))
            more = np.zeros((self._scene.owned_nodes, *away.shape[1:]))
            more[body.data.nodes] = away
            if about.on_supports:  # by their forces at cells beside it
                more[body.data.nodes] = forces + part.times_stiffness(away)
                more = np.asarray(responses.solve(more))
            part.extend(basis, more, more.shape[2])
        for _ in range(PULLS):
            if not fields.shape[2]:
                break
            F, n = np.zeros((self._scene.owned_nodes, 3, fields.shape[2])), len(basis)
            F[body.data.nodes] = part.pull(stresses(at), fields)
            part.extend(basis, responses.solve(F), F.shape[2])
            fields = basis.vectors[:, :, n:]
        return self._extended(body, part, basis, m)

    def _tell_more(self, name: str, before: int, now: int, all_of_them: bool) -> None:
        """Log new shapes; warn once of forces for which there is no room. Collective."""
        if now > before:
            text = f"{now - before} shapes more, {now} in all, as nodes begin to press"
            tell(self._scene.comm, f"Reduced '{name}': {text}")
        if not all_of_them and name not in self._full:
            self._full.add(name)
            warn(
                self._scene.comm,
                f"Reduced '{name}': more of its nodes press than {MOST} shapes follow, and "
                "its contact forces are too large. Leave a layer of flexible cells where it "
                "meets an obstacle.",
            )

    def warn_of_unspanned(self, state: State) -> None:
        """Warn of loads whose static responses shapes lack in part. Collective."""
        for body in state.bodies:
            if body.data.shapes is None:
                continue
            loads, part = self._loads[body.data.name], self._part(body.data)
            own = part.projected(_free(body.data))
            about = self._expanded[body.data.name][1]
            if count := about.unspanned(own.modes, own.stiffness, loads)[0].shape[2]:
                warn(
                    self._scene.comm,
                    f"Reduced '{body.data.name}': shapes={len(own.force)} lack more than "
                    f"{LACKING:.0%} of the response to {count} of {loads.shape[2]} patterns of "
                    "loads. Ask for more, or leave shapes= out.",
                )

    def richer(self, bodies: Bodies, fields: Array) -> Bodies:
        """The bodies, those with shapes with more of them, to see how far others are off modes.

        They are static responses to the inertia of modes, φ at the owned nodes, (owned nodes, 3, n)
        [1/√kg], which take most of the error out of these (inverse iteration; J. H. Wilkinson, The
        Algebraic Eigenvalue Problem, 1965, Section 9.55), and to accelerations that are polynomials
        of second order in place, which find modes that shapes lack. Collective.
        """
        responses = self._bind()
        size = np.linalg.norm(self._scene.parts.upper - self._scene.parts.lower)
        x = (responses.stiffness.places - self._scene.centre_of_mass) / size
        x, (i, j) = np.c_[np.ones(len(x)), x], np.triu_indices(4)
        F = np.einsum("ac,nt->nact", np.eye(3), x[:, i] * x[:, j]).reshape(len(x), 3, -1)
        more = responses.solve(responses.inertia(np.concatenate([fields, F], axis=2)))
        each = []
        for body in bodies:
            if body.data.shapes is not None:
                part = self._part(body.data)
                known = part.still(_free(body.data))
                basis = part.begun(known)
                part.extend(basis, more, more.shape[2], more.shape[2])
                body = self._extended(body, part, basis, known.shape[2])
            each.append(body)
        return Bodies.of_each(each)

    def followed(self, state: State) -> dict[str, float]:
        """ν of each part; where contacts press one, cells may leave it. Collective.

        None leaves with a consistent mass: nodes of cells beside a part have velocities of their
        own there, with which the energy of those that leave would be another one.
        """
        if not self._growing or self._scene.mass != "lumped":
            return self.spent.follow(state)
        loose = self._loose | self._pressing.pressed
        return self.spent.follow(state, dict.fromkeys(self._growing, loose))

    def about(self, body: Body) -> About:
        """The expansion of a body, about the start. Collective."""
        self._bind()
        self._part(body.data)
        return self._expanded[body.data.name][1]

    def destroy(self) -> None:
        """Free factor and matrices. Collective."""
        free(*(about for _, about in self._expanded.values()), self._responses)
        self._expanded.clear()
        self._responses = None


def _free(data: RigidBody) -> Array:
    """The shapes of a body but those that follow supports, shape (nodes, 3, m)."""
    given = 0 if data.shapes is None else data.shapes.given
    return whole_modes(data).swapaxes(1, 2)[:, :, given:]


def whole_modes(data: RigidBody) -> Array:
    """Shapes at the nodes of a body, with the drift of those that are held, shape (nodes, m, 3)."""
    return np.zeros((data.nodes.size, 0, 3)) if data.shapes is None else data.shapes.whole
