"""What rigid bodies would strain: a linear twin of each, carried along from step to step.

Two responses to the force that rigidity takes over tell what is withheld: the *shadow*

    M δ̈ + C δ̇ + K δ = ρ,    δ̇ = R ΔV at the freeze, the velocities that it took out of the motion,

which sees waves and resonance, and the response K⁺ρ to a load slower than the body, which sees what
a damped shadow does not. The larger rate is each cell's. Calm shadows take long steps, see `pace`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from rigidfx.coupling.mass import Mass
from rigidfx.effects import Rigid, Support
from rigidfx.flexible.indicator import Indicator
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.shadow.gauge import Gauge
from rigidfx.shadow.handover import Carried
from rigidfx.shadow.hanging import Hanging
from rigidfx.shadow.margin import Margin
from rigidfx.shadow.motion import Limits, Motion, Strained, at_rest
from rigidfx.shadow.pace import Pace
from rigidfx.shadow.parts import Parts
from rigidfx.shadow.response import Response
from rigidfx.shadow.strongest import Strongest
from rigidfx.shadow.subjects import Force, Subjects
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt
from rigidfx.step.watches.watch import Watch

__all__ = ["Shadow"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]

# What PETSc's log calls these parts of a run.
_REGROUPING = PETSc.Log.Event("rigidfxShadowNew")
_LOOKING = PETSc.Log.Event("rigidfxShadow")


class Shadow(Watch):
    """The shadows of the bodies of a run; `destroy` frees the PETSc objects.

    Attributes:
        withheld: Energy that rigidity withholds, ½ ρᵀK⁺ρ, when shadows last took a step [J].
        dt: Length of the last step [s].
        linear: Forms about the shape that bodies are frozen in.
        borne: Bodies in the step that was looked at last, and ρ in their frames [N]; None without.
    """

    def __init__(
        self, stepper: Stepper, subjects: Subjects, indicator: Indicator, settling: float
    ) -> None:
        """Compile the forms. Collective.

        Args:
            stepper: Solves the steps.
            subjects: What has shadows.
            indicator: A measure of its own for the bodies' cells.
            settling: Time in which a drag takes the shadows' vibration out [s].
        """
        self._stepper, self._subjects = stepper, subjects
        self.linear = LinearForms(stepper.scene, stepper.forces)
        self._gauge = Gauge(stepper.scene.space, indicator)
        self._settling = settling
        self.withheld, self._energies = 0.0, np.zeros(2)
        self._system: object = None
        self.dt, self._ended = 0.0, False  # `_ended`: whether the last step was all
        self._margin: Margin | None = None
        self._response: Response | None = None
        self._pace = Pace()
        # Viscous stresses and supports that act, and bodies that are in the way.
        self._around: tuple[list[int], tuple[Support, ...], list[int]] = [], (), []
        self._accepting: Callable[[], None] | None = None
        self._strongest = Strongest()
        self._mass: Mass | None = None
        self._force: Force | None = None
        self.borne: tuple[Parts, Array] | None = None

    def follow(self, dt: float) -> None:
        """Have the shadows of the present bodies; their motion is carried over. Collective.

        Args:
            dt: Length of the present step [s].
        """
        stepper, old, subjects = self._stepper, self._margin, self._subjects
        if stepper.system is self._system:
            return
        self._system = stepper.system
        before, records = subjects.last, subjects.records()
        viscous = [k for k, _ in stepper.forces.viscous_terms]
        same = old is not None and [*map(id, records)] == [*map(id, old.parts.bodies)]
        others = [*map(id, stepper.state.bodies.of.records)]
        around = viscous, stepper.prescribed.active, others
        if not same or around != self._around:
            self._around = around
            self._catch_up()
            motion = at_rest(0) if self._response is None else self._response.motion
            carried = Carried(stepper.scene.owned_nodes, old, before, motion)
            self._release()
            self.withheld, self._energies = 0.0, np.zeros(2)
            self._margin = Margin(stepper, subjects, records) if records else None
            if self._margin is not None:
                self._begin(self._margin, carried, None if old is None else dt, dt)
        elif self._force is not None:
            self._force.destroy()
        if self._margin is not None:
            assert self._mass is not None
            self._force = subjects.force(self._margin.parts, self._mass, self.linear)
        subjects.follow()

    @property
    def stiffening(self) -> float | None:
        """What bodies withhold over the strain of their own cells, in energies; None if unknown."""
        every, own = self._energies
        return max(1.0, float(every / own)) if own > 0 else None

    def _catch_up(self) -> None:
        """Take the steps that calm shadows have not taken. Collective."""
        if self._response is not None:
            self._response.catch_up(self._pace.waiting, self._stepper.state.t)
        self._pace, self._accepting = Pace(), None

    def _begin(self, margin: Margin, carried: Carried, ringing: float | None, dt: float) -> None:
        """Have shadows of other bodies. Collective."""
        stepper = self._stepper
        self._mass = margin.parts.mass()
        response = Response(stepper, margin, self.linear, self._settling, dt)
        hanging = partial(Hanging, stepper, margin.parts, self._subjects.held())
        self._gauge.bind(margin, self.linear.shape, hanging)
        motion, grown = carried.by(stepper.scene, margin, self._subjects.present())
        response.begin(motion, grown, stepper.state.t, ringing)
        self._response = response

    def look(self, t: float, dt: float, limits: Callable[[], Limits]) -> Strained | None:
        """What the bodies withhold in the step that has been solved. Collective.

        Args:
            t: Time at its start [s].
            dt: Its length [s].
            limits: Says what wakes cells; not asked without bodies. Collective.

        Returns:
            What each owned cell would strain. None without bodies, or where calm shadows take no
            step.
        """
        with _REGROUPING:
            self.follow(dt)
        self.borne = None
        if self._margin is None or self._force is None or self._response is None:
            return None
        self._gauge.looks += 1
        with _LOOKING:
            force = self._force.force(t, dt, self._pace.little)
            self.borne = self._margin.parts, force
            change = self._margin.parts.change(self._pace.last, force)
            if self._response.rests(force, self._pace.last, change):
                self._accepting = partial(self._pace.rest, force)
                return None
            if not self._pace.due(force, dt, change):
                self._accepting = partial(self._pace.wait, force, dt, change)
                return None
        self._factor(force, t, dt)
        with _LOOKING:
            known = limits()
            motion, found = self._foreseen(force, t, dt, known)
            comm, reached = self._stepper.scene.comm, known.reached
            largest = found.largest(comm) if reached is None else np.full(2, reached)
            parts, mean = self._margin.parts, self._pace.stretches(force, dt)[-1][0]
            told, sizes = self._response.withheld(motion, force, mean)
            found = replace(found, withheld=parts.by_name(sizes))

            def accepting() -> None:
                self._take(motion, force, dt, change, largest, told)
                self._strongest.note(parts, found.withheld, force)

            self._accepting = accepting
            return found

    def ahead(self, t: float, dt: float, limits: Callable[[], Limits]) -> Strained | None:
        """What the bodies will withhold in a step that is still to be solved. Collective.

        The force on them is that of the last step and what loads on the bodies themselves change of
        it. Of bodies that have just frozen that change alone is known. Arguments as of `look`.

        Returns:
            What each owned cell would strain; None where loads change no more than usual.
        """
        with _REGROUPING:
            self.follow(dt)
        if self._margin is None or self._force is None:
            return None
        with _LOOKING:
            rise = self._force.rise(t, dt, self._pace.alarming)
            if rise is None:
                return None
        last = self._pace.last
        if last is None:
            return self._struck(rise, t, dt, limits())
        self._factor(last + rise, t, dt)
        with _LOOKING:
            return self._foreseen(last + rise, t, dt, limits(), struck=True)[1]

    def _struck(self, force: Array, t: float, dt: float, limits: Limits) -> Strained:
        """What a force alone would strain in a step from rest. Collective."""
        response = self._response
        assert response is not None
        with _REGROUPING:
            response.factor(t, dt)
        with _LOOKING:
            rest = at_rest(len(response.motion.u), known=True)
            motion = response.stepped(rest, force, t, dt)
            return self._gauge.strained(rest, motion, dt, limits, None, struck=True)

    def _factor(self, force: Array, t: float, dt: float) -> None:
        """Have the factors for the steps that shadows are to take. Collective."""
        assert self._response is not None
        with _REGROUPING:
            _, span = self._pace.stretches(force, dt)[0]
            self._response.factor(t - sum(waited for _, waited in self._pace.waiting), span)

    def _foreseen(
        self, force: Array, t: float, dt: float, limits: Limits, *, struck: bool = False
    ) -> tuple[Motion, Strained]:
        """The motion at the end of a step under a force, and what cells strain. Collective."""
        response = self._response
        assert response is not None
        response.mean_over(limits.window, dt)
        steps = self._pace.stretches(force, dt)
        response.shorten(steps[0][1], t)
        motion = response.start(force, dt)
        begin = t - sum(span for _, span in self._pace.waiting)
        found: Strained | None = None
        for mean, span in steps:
            start, motion = motion, response.stepped(motion, mean, begin, span)
            found = self._gauge.strained(start, motion, span, limits, found, struck=struck)
            begin += span
        assert found is not None
        # Within a step cells spring, however long that of shadows was.
        return motion, replace(found, spring=found.spring * (span / dt))

    def _take(
        self, motion: Motion, force: Array, dt: float, change: float, largest: Array, told: Array
    ) -> None:
        assert self._response is not None
        self._response.take(motion, force, self._pace.stretches(force, dt)[-1][1])
        self.withheld = float(told[2:].sum())
        self._energies += told[:2]
        self._pace.taken(force, change, *map(float, largest))

    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        if self._accepting is not None:
            self._accepting()
        self._accepting = None
        self.dt = attempt.dt
        self._subjects.accept(attempt)

    def recovered(self) -> tuple[Array, Ints]:
        """See `Shadows`. Collective."""
        return self._in_space(self._at_rest())

    def moved(self) -> tuple[Array, Ints]:
        """δ in space without rigid motions, and the cells that it is of, likewise. Collective."""
        self._catch_up()
        return self._in_space(None if self._response is None else self._response.moved)

    def _in_space(self, u: Array | None) -> tuple[Array, Ints]:
        """Displacements of the bodies' nodes, and their cells. Collective."""
        out = np.zeros((self._stepper.scene.owned_nodes, 3))
        if self._margin is None or u is None:
            return out, np.empty(0, np.int32)
        u = self._margin.parts.unmoved(u)
        return self._margin.parts.in_space(u, self._subjects.present(), out)

    def loaded(self) -> list[tuple[RigidBody, Array]]:
        """Bodies with parts named rigid, and ρ of the last step in space [N]. Collective."""
        force = self._last() if self._stepper.scene.named(Rigid) else None
        if self._margin is None or force is None:
            return []
        return self._margin.parts.named(force, self._subjects.present())

    def share(self, name: str) -> float | None:
        """See `Shadows`; None of what has no shadow. Collective."""
        return self._strongest.share(name, self._stepper, self._subjects.present(), self.dt)

    def remember(self) -> None:
        """Have what is known of the last step outlast its equations. Collective."""
        self._subjects.remember()

    def forget(self) -> None:
        """Have nothing known of the last step: an error has left its equations as it found them."""
        if not self._subjects.free:
            self.dt = 0.0

    def _last(self) -> Array | None:
        """ρ of the last step in the bodies' frames; None if there is none. Collective."""
        if not self._subjects.free and self.dt > 0:  # such parts may not be looked at any more
            self._subjects.remember()
            with _REGROUPING:
                self.follow(self.dt)
        if self._margin is None or self._response is None:
            return None
        if self._pace.last is not None and self._force is not None:
            self._pace.last = self._force.exact(self._pace.last)
        carried = self._subjects.carried(self._margin.parts)
        return self._pace.last if carried is None else carried

    def _at_rest(self) -> Array | None:
        """K⁺ρ of the last step in the bodies' frames; None if there is none. Collective."""
        force = self._last()
        if force is None or self._margin is None or self._response is None:
            return None
        out = self._response.part.at_rest(force)[self._margin.inside]
        if self._ended:
            self._free()
        return out

    def _release(self) -> None:
        for item in (self._force, self._response, self._mass):
            if item is not None:
                item.destroy()
        self._force, self._response, self._mass = None, None, None

    def _free(self) -> None:
        """Free the PETSc objects; the last K⁺ρ stays known. Collective."""
        response = self._response
        self._release()
        self._response = response

    def destroy(self) -> None:
        """Free the PETSc objects; what bodies carry may still be asked for. Collective."""
        if self._subjects.free:
            self._at_rest()
        else:  # only who asks has it computed
            self._system = self._margin = None
            self._pace = Pace()
        self._free()
        self._ended = True
