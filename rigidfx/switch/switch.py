"""Apply decisions, and release bodies when effects begin or end.

Decision → exchange of momenta and energy → inventory of bodies → stepper bound anew → Event
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from rigidfx import effects as fx
from rigidfx.base.errors import InversionError, SceneError, together
from rigidfx.base.remembered import OBJECTS, PART, Remembered, same
from rigidfx.base.warning import warn
from rigidfx.decide.bodies import Decision
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.effects.joints.remote import body_of
from rigidfx.growth.found_bodies import FoundBodies
from rigidfx.growth.shaping import Shaping
from rigidfx.inventory.inventory import check_clamps, divide
from rigidfx.inventory.mass_properties import at_nodes, mass_properties
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, RigidBody
from rigidfx.report.events import BodyChange, Event
from rigidfx.report.start import Start
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline
from rigidfx.state import initial_velocity
from rigidfx.step.equations.division import Division
from rigidfx.step.equations.supports import Impact, PrescribedDofs, supports_of
from rigidfx.step.load_path import apply_preload
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import INVERTED, remedy
from rigidfx.switch.exchange import Exchange, Works


class Switch:
    """Divides the cells of a stepper: at the start, as decisions say, and as effects come and go.

    Attributes:
        acting: The effects with a time window that act.
        shaping: Gives parts named `Reduced` their shapes.
        held: Force of each support in a static preload [N], and its moment [N m]: see `begin`.
        clamps: Whether a support clamps a part named rigid at any time: likewise.
    """

    remembered: ClassVar[Remembered] = same("_told", "_pending") | {
        "acting": OBJECTS,
        "shaping": PART,
    }

    def __init__(self, stepper: Stepper, timeline: Timeline, start: Start | None = None) -> None:
        """Keep a stepper that is not bound yet; a start, if any, in place of the scene's."""
        self._stepper, self._timeline, self._start = stepper, timeline, start
        scene = stepper.scene
        self._told: set[str] = set()  # rows of joints that others imply
        self._grounded = any(joint.holds for joint in scene.named(fx.Joint))
        self._exchange = Exchange(scene, stepper.forces)
        self.acting = scene.acting(timeline.after(0.0))
        self.shaping = Shaping(scene, stepper.forces, self.acting, timeline.t_end, timeline.least)
        self._pending = self._breakpoints_after(0.0)

    def _breakpoints_after(self, t: float) -> tuple[float, ...]:
        """Breakpoints of the effects later than t [s], and infinity, sorted."""
        later = (b for b in self._stepper.scene.breakpoints if b > self._timeline.after(t))
        return (*later, np.inf)

    def _bind(self, found: Sequence[Body]) -> None:
        """Bind the stepper to named bodies and to those found. Collective."""
        stepper = self._stepper
        scene, state, supports = stepper.scene, stepper.state, supports_of(self.acting)
        shape = partial(self.shaping.shaped, state)
        division = divide(scene, stepper.forces, state, supports, found, shape)
        known = division.driven_nodes, division.nodes_of_held
        prescribed = PrescribedDofs(scene, supports, *known).mask
        self._exchange.settle(state, division, prescribed)
        stepper.bind(replace(division, bodies=state.bodies), self.acting)
        linkage = stepper.system.linkage
        if linkage is not None and (new := set(linkage.rows.redundant) - self._told):
            self._told |= new
            titles = tuple(linkage.rows.redundant)
            warn(
                scene.comm,
                f"{len(titles)} of the rows of joints follow from others and are left out: "
                f"{'; '.join(titles)}. The motion is the same; how forces are shared among the "
                "joints that hold the same is not determined.",
            )

    def _started(self, known: Set[int] = frozenset()) -> tuple[fx.Motor, ...]:
        """Motors that start to prescribe a motion, beside the effects known, by identity."""
        motors: tuple[Any, ...] = tuple(e for e in self.acting if e.prescribes)
        self._exchange.motors, self._exchange.dt = motors, self._timeline.dt
        return tuple(motor for motor in motors if id(motor) not in known)

    @property
    def scene(self) -> Scene:
        """The problem."""
        return self._stepper.scene

    def again(self) -> None:
        """Bind the stepper anew as it is: nothing is known of equations and factors. Collective."""
        self.clamps = check_clamps(self._stepper.scene, self._timeline)
        self._stepper.renew()
        self._started()
        self._bind(list(self._stepper.state.bodies))

    def begin(self) -> Impact | None:
        """Bring the state into its initial one, and bind the stepper. Collective.

        Returns:
            Velocity that supports have imposed at the start; None if they have not.

        Raises:
            SceneError: If the initial velocity contradicts a support, a preload is not held, or a
                joint is beyond a limit of a `Stop`.
            StepError: If the static preload does not converge.
            InversionError: If it turns cells inside out.
        """
        stepper, dt = self._stepper, self._timeline.dt
        scene, state = stepper.scene, stepper.state
        start = self._timeline.after(0.0)
        self.clamps = check_clamps(scene, self._timeline)
        supports = supports_of(self.acting)

        def divided(acting: Sequence[fx.Windowed]) -> Division:
            return divide(scene, stepper.forces, state, supports_of(acting))

        self.held = apply_preload(scene, stepper.forces, state, start, divided)
        if self._start is not None:
            self._start.apply(state)
        if scene.named(fx.InitialDisplacement):
            state.place((scene.start_places - state.X).reshape(-1))
        x = state.X + state.u.x.array.reshape(-1, 3)
        state.move(initial_velocity(scene, x, dt, start).reshape(-1))
        self._set_moving()
        self._bind([])
        if self._start is None and not scene.named(fx.Preload):
            _check_stops(stepper.system.linkage)
        impact = self._closed(stepper.meet(supports, dt, stepper.measure()))
        if started := self._started():
            impact = self._closed(impact, started)
        made = {fx.Preload: "The static preload", fx.InitialDisplacement: "The InitialDisplacement"}
        by = "".join(words for kind, words in made.items() if scene.named(kind))
        if by and (turned := stepper.inverted()) is not None:
            found = f"{by} turns cells inside out: {turned}{INVERTED}"
            raise InversionError(found, remedy(scene))
        return impact

    def _set_moving(self) -> None:
        """Give bodies that statics have placed the motion of their nodes, or face. Collective."""
        scene, state, forces = self._stepper.scene, self._stepper.state, self._stepper.forces
        motions, (x, _, v) = [], at_nodes(state)
        carried = {mass.title: mass for mass in scene.named(fx.PointMass) if mass.is_carried}
        for body in state.bodies:
            if body.data.name in carried:
                _, motion = body_of(carried[body.data.name], scene, x, v, body.data.number)
                motions.append((motion.velocity, motion.angular_velocity_body))
                continue
            p = mass_properties(scene, forces.cells(body.data.cells), body.data.nodes, x, v)
            motions.append((p.velocity, body.motion.R.T @ p.angular_velocity))
        if motions:
            state.group(state.bodies.moving(*map(np.array, zip(*motions, strict=True))))

    @property
    def due(self) -> bool:
        """Whether effects begin or end now, or a prescribed motion jumps."""
        control = self._stepper.control
        found = control is not None and control.jumped
        return found or self._stepper.state.t >= self._pending[0] - self._timeline.resolution

    def follow_effects(self, dt: float) -> Impact | None:
        """Bind anew where effects begin or end; the velocity that supports impose. Collective."""
        if not self.due:
            return None
        stepper, timeline = self._stepper, self._timeline
        state, scene = stepper.state, stepper.scene
        t, before, control = state.t, self.acting, stepper.control
        found = control is not None and control.jumped
        self._pending = self._breakpoints_after(t)
        self.acting = scene.acting(timeline.after(t))
        known = {id(effect) for effect in before}
        jumping = tuple(
            support
            for support in supports_of(self.acting)
            if id(support) not in known
            or any(timeline.same(t, b) for b in support.breakpoints)
            or (found and support.moves)
        )
        # A body that a support takes over must count as the body here: interface nodes of the
        # flexible side have velocities of their own.
        both = known & {id(effect) for effect in self.acting}
        every: list[Any] = [e for e in (*before, *self.acting) if id(e) not in both]
        contacts = [effect for effect in every if effect.is_contact]  # that begin or end
        started = self._started(known)
        measures = stepper.measure() if jumping or contacts or started else None
        for contact in contacts:
            state.notes.pop(id(contact), None)  # what it remembers ends with it
        if not stepper.system.follow(self.acting):
            state.rebuild()
            # A support may take named bodies over, and others do not outlast its start and end.
            same = supports_of(self.acting) == supports_of(before)
            self._bind(list(state.bodies) if same else [])
        if measures is None:
            return None
        begun = stepper.press(contacts, measures)
        impact = stepper.meet(jumping, dt, measures)
        if impact is not None or started:
            impact = self._closed(impact, started)
        return impact + begun if impact and begun else impact or begun

    def _closed(self, impact: Impact | None, started: Sequence[fx.Motor] = ()) -> Impact | None:
        """Impact with impulses of joints, which close them, and of new motors. Collective."""
        if not self._exchange.joined:
            return impact
        stepper = self._stepper
        state, scene, before = stepper.state, stepper.scene, stepper.measure()
        rests = before.kinetic == 0.0  # velocities that are zero keep joints closed
        if (linkage := stepper.system.linkage) is not None:
            apart = partial(linkage.drives.apart, state.t, started)
            for found in together(scene.comm, "A motor", apart):
                warn(scene.comm, f"{found}: it is thrown there in one step. Let both be the same.")
            if started:
                speeds = partial(linkage.drives.speeds, state.t, self._exchange.dt)
                rests &= not together(scene.comm, "A motor", speeds).any()
        if rests:
            return impact
        state.rebuild()
        gained = self._exchange.close(state, stepper.system.prescribed.mask)
        if gained == 0.0:
            return impact
        titles = [motor.owner for motor in started] or [j.title for j in scene.named(fx.Joint)]
        changes = stepper.measure().momenta_since(before)
        own = Impact(state.t, tuple(titles), gained, *changes, 0.0)
        if not started:
            warn(
                scene.comm,
                f"At t = {state.t:g} s velocities do not fit the joints ({', '.join(titles)}): "
                f"impulses of these change the kinetic energy from {before.kinetic:.6g} to "
                f"{before.kinetic + gained:.6g} J. Give velocities that leave joints closed.",
            )
        return own if impact is None else impact + own

    def grow(self, dt: float) -> bool:
        """Give bodies shapes that the last attempt, of dt [s], calls for; whether any. Collective.

        It is to be made again then: a node that presses does so on shapes that yield.
        """
        if not self.shaping.grows:
            return False
        stepper = self._stepper
        pressing = stepper.system.actions.pressing()
        grown = self.shaping.grown(stepper.state, pressing, dt)
        if grown is None:
            return False
        self.regroup(grown)
        return True

    def renew(self) -> None:
        """Take cells out of named parts that a contact presses, or give these Γ. Collective."""
        state, shaping = self._stepper.state, self.shaping
        loosened = shaping.loosened(state)
        if loosened is not None:
            state.group(loosened)
        taut, bodies = shaping.spent.taut(state.bodies), state.bodies
        if taut or loosened is not None:
            self.regroup(shaping.tensed(bodies, bodies, taut) if taut else bodies)

    def regroup(self, bodies: Bodies) -> None:
        """Replace the bodies by those with more shapes, or fewer cells. Collective."""
        self._stepper.state.group(bodies)
        self._bind(list(bodies))

    def shape_found(self, found: FoundBodies) -> None:
        """Give shapes to bodies that are found."""
        self._exchange.shape = found.shaped
        self._exchange.leave = found.shift

    def apply(self, decision: Decision) -> Event | None:
        """Make the bodies those of a decision; the event, None if there was none. Collective."""
        stepper = self._stepper
        state = stepper.state
        old = {b.number: b for b in state.bodies.of.records if _changes_with(b, decision)}
        kept = {body.number for body in decision.bodies if body.kept}
        if len(kept) == len(decision.bodies) == len(old):
            return None
        before, unknowns = stepper.measure(), stepper.unknowns
        held_before = stepper.system.energies.held_momenta(stepper.state)
        prescribed = stepper.system.prescribed.mask
        leaving = old.keys() - kept
        works = [self._exchange.release(state, leaving, prescribed)]
        for body in decision.bodies:
            if not body.kept:
                works.append(self._exchange.freeze(state, body, prescribed))
        work = Works(*map(sum, zip(*works, strict=True)))
        found = [body for body in state.bodies if _changes_with(body.data, decision)]
        self._bind(found)
        changes = _changes(old, {body.data.number: body.data for body in found})
        if not changes:  # what was to freeze could not be a body
            return None
        after = stepper.measure()
        # Bodies and free nodes keep their momenta: what held dofs gain is what supports give.
        impulse, angular_impulse = stepper.system.energies.held_momenta(stepper.state) - held_before
        linear, angular = np.subtract(after.momenta_since(before), (impulse, angular_impulse))
        if self._grounded:  # the ground gives what is left, by impulses of joints
            impulse, angular_impulse = impulse + linear, angular_impulse + angular
            linear, angular = np.zeros(3), np.zeros(3)
        return Event(
            t=state.t,
            kind=decision.kind,
            reason=decision.reason,
            changes=changes,
            unknowns_before=unknowns,
            unknowns_after=stepper.unknowns,
            energy_frozen=max(after.stored - before.stored, 0.0),
            energy_released=max(before.stored - after.stored, 0.0),
            energy_lost=before.energy + work.whole - after.energy,
            work_of_supports=work.supports,
            work_of_motors=work.motors,
            impulse=impulse,
            angular_impulse=angular_impulse,
            linear_momentum_error=float(np.linalg.norm(linear)),
            angular_momentum_error=float(np.linalg.norm(angular)),
            woken=np.empty(0, np.int32) if decision.woken is None else decision.woken,
        )


def _changes_with(body: RigidBody, decision: Decision) -> bool:
    """Whether a decision tells the fate of a body: not of those apart, nor of rigid faces."""
    return not body.is_face and body.name not in decision.apart


def _changes(old: Mapping[int, RigidBody], new: Mapping[int, RigidBody]) -> tuple[BodyChange, ...]:
    """How bodies before and after an event differ, by number."""
    changes = []
    for number in sorted(old.keys() | new.keys()):
        before, after = old.get(number), new.get(number)
        if before is after:
            continue
        changes.append(
            BodyChange(
                name=(after or before).name,  # type: ignore[union-attr]
                number=number,
                cells_before=before.size if before else 0,
                cells_after=after.size if after else 0,
                stored_before=before.frozen.energy if before else 0.0,
                stored_after=after.frozen.energy if after else 0.0,
            )
        )
    return tuple(changes)


def _check_stops(linkage: Linkage | None) -> None:
    """Refuse stops, on every rank, that would throw a joint back from beyond a limit."""
    if linkage is not None and (found := linkage.drives.beyond()):
        raise SceneError(
            f"{found[0]} at the start, where the stop would throw it back. Angles and travels "
            "count from the places of the mesh: give limits around the place of the start, or "
            "start from `rf.static`, whose springs are in balance."
        )
