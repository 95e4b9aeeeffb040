"""What rigid bodies would strain: a linear twin of each, carried along from step to step.

Two responses to the force that rigidity takes over tell what is withheld: the *shadow*

    M δ̈ + C δ̇ + K δ = ρ,    δ̇ = R ΔV at the freeze, the velocities that it took out of the motion,

which sees waves and resonance, and the response K⁺ρ to a load slower than the body, which sees what
a shadow that is damped does not. The larger of their strain rates is each cell's. Shadows that are
calm take long steps, see `pace`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.instants import same_length
from rigidfx.coupling.mass import Mass
from rigidfx.effects import Support
from rigidfx.flexible.indicator import Indicator
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.bodies import Bodies
from rigidfx.shadow.dashpots import of_neighbours
from rigidfx.shadow.gauge import Gauge
from rigidfx.shadow.handover import Carried
from rigidfx.shadow.linear_part import LinearPart
from rigidfx.shadow.margin import Margin
from rigidfx.shadow.motion import Limits, Motion, Strained, at_rest
from rigidfx.shadow.pace import Pace, Stretch
from rigidfx.shadow.parts import watched
from rigidfx.shadow.withheld import Withheld
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt
from rigidfx.step.watches.watch import Watch

__all__ = ["Shadow"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]

# What PETSc's log calls these parts of a run.
_REGROUPING = PETSc.Log.Event("rigidfxShadowNew")
_LOOKING = PETSc.Log.Event("rigidfxShadow")

# Part of a window over which K⁺ρ is meant before it has a rate: what is faster than that shadows
# see, and a body's response to it is none of a body at rest.
LAG = 0.25


class Shadow(Watch):
    """The shadows of the bodies of a run; `destroy` frees the PETSc objects.

    Attributes:
        withheld: Strain energy that rigidity withholds, ½ ρᵀK⁺ρ, when shadows last took a step [J].
    """

    def __init__(
        self,
        stepper: Stepper,
        indicator: Indicator,
        settling: float,
        in_pieces: frozenset[str] = frozenset(),
    ) -> None:
        """Compile the forms. Collective.

        Args:
            stepper: Solves the steps.
            indicator: A measure of its own for the bodies' cells.
            settling: Time in which a drag takes the shadows' vibration out [s].
            in_pieces: Parts named rigid whose cells are not connected through facets: nothing
                tells what goes from piece to piece, and their bodies have no shadow.
        """
        self._in_pieces, self._stepper = in_pieces, stepper
        self._linear = LinearForms(stepper.scene, stepper.forces)
        self._gauge = Gauge(stepper.scene.space, indicator)
        self._settling = settling
        self.withheld, self._energies = 0.0, np.zeros(2)
        self._system: object = None
        self._bodies = Bodies.of_each(())  # of the last accepted step
        self._margin: Margin | None = None
        self._motion = at_rest(0)
        self._pace, self._lag = Pace(), np.inf
        self._last: Stretch = (np.empty((0, 3)), 0.0)  # ρ of shadows' last step, and its length
        # Viscous stresses and supports that act.
        self._around: tuple[list[int], tuple[Support, ...]] = [], ()
        self._accepting: Callable[[], None] | None = None
        self._grown: list[npt.NDArray[np.int64]] = []  # rows of bodies that have just grown
        self._mass: Mass | None = None
        self._part: LinearPart | None = None
        self._withheld: Withheld | None = None

    # Which bodies -------------------------------------------------------------------------------

    def follow(self, dt: float) -> None:
        """Have the shadows of the present bodies; their motion is carried over. Collective.

        Args:
            dt: Length of the present step [s].
        """
        stepper, old = self._stepper, self._margin
        if stepper.system is self._system:
            return
        self._system = stepper.system
        records = watched(stepper.state.bodies.of.records, self._in_pieces)
        viscous = [k for k, _ in stepper.forces.viscous_terms]
        same = old is not None and [*map(id, records)] == [*map(id, old.parts.bodies)]
        around = viscous, stepper.prescribed.active
        if not same or around != self._around:
            self._around = around
            self._catch_up()
            carried = Carried(stepper.scene.owned_nodes, old, self._bodies, self._motion)
            self._release()
            self.withheld, self._energies = 0.0, np.zeros(2)
            self._margin = Margin(stepper, records) if records else None
            if self._margin is not None:
                self._assemble(self._margin, dt)
                bodies = stepper.state.bodies
                self._motion, self._grown = carried.by(stepper.scene, self._margin, bodies)
                if old is not None:
                    # What rings from step to step would become displacements of other cells.
                    assert self._part is not None
                    damping = self._damping(stepper.state.t + dt / 2)
                    self._motion.v = self._part.resolved(self._motion.v, dt, *damping)
        elif self._withheld is not None:
            self._withheld.destroy()
        if self._margin is not None:
            assert self._mass is not None
            self._withheld = Withheld(stepper, self._margin.parts, self._mass, self._linear)
        self._bodies = stepper.state.bodies

    @property
    def stiffening(self) -> float | None:
        """What bodies withhold over the strain of their own cells, in energies; None if unknown."""
        every, own = self._energies
        return max(1.0, float(every / own)) if own > 0 else None

    def _catch_up(self) -> None:
        """Take the steps that calm shadows have not taken. Collective."""
        begin = self._stepper.state.t - sum(span for _, span in self._pace.waiting)
        for force, span in self._pace.waiting:
            self._shorten(span, begin)
            self._motion = self._stepped(self._motion, force, begin + span / 2, span)
            begin += span
        self._pace, self._last, self._accepting = Pace(), (np.empty((0, 3)), 0.0), None

    def _assemble(self, margin: Margin, dt: float) -> None:
        """Make matrices and factors, and take the shape over. Collective."""
        stepper, linear = self._stepper, self._linear
        linear.shape.x.array[:] = 0.0
        dashpots = of_neighbours(stepper, margin.rows, margin.beyond, linear)
        linear.shape.x.array[margin.rows.dofs] = margin.shape
        linear.shape.x.scatter_forward()
        self._mass = margin.parts.mass()
        stepper.forces.set_rate(1.0)
        self._part = LinearPart(margin, linear, dashpots)
        stepper.forces.set_rate(1 / dt)
        self._gauge.bind(margin, linear.shape)

    # Steps --------------------------------------------------------------------------------------

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
        if self._margin is None or self._withheld is None or self._part is None:
            return None
        self._gauge.looks += 1
        with _LOOKING:
            force = self._withheld.force(t, dt, self._pace.little)
            change = self._margin.parts.change(self._pace.last, force)
            if not self._pace.due(force, dt, change):
                self._accepting = partial(self._pace.wait, force, dt, change)
                return None
        self._factor(force, t, dt)
        with _LOOKING:
            known = limits()
            motion, found = self._foreseen(force, t, dt, known)
            scene = self._stepper.scene
            largest = np.full(2, 0.0 if known.reached is None else known.reached)
            if known.reached is None:
                largest[:] = found.largest
                scene.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
            still = motion.still[self._margin.inside]
            told = scene.sum([0.5 * np.vdot(force, still), *self._part.energies()])
            self._accepting = partial(self._take, motion, force, dt, change, largest, told)
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
        if self._margin is None or self._withheld is None:
            return None
        with _LOOKING:
            rise = self._withheld.rise(t, dt, self._pace.alarming)
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
        assert self._part is not None
        with _REGROUPING:
            self._part.factored(dt, *self._damping(t + dt / 2))
        with _LOOKING:
            rest = Motion(*np.zeros((5, *self._motion.u.shape)))
            motion = self._stepped(rest, force, t + dt / 2, dt)
            return self._gauge.strained(rest, motion, dt, limits, None, struck=True)

    def _factor(self, force: Array, t: float, dt: float) -> None:
        """Have the factors for the steps that shadows are to take. Collective."""
        assert self._part is not None
        with _REGROUPING:
            _, span = self._pace.stretches(force, dt)[0]
            begin = t - sum(waited for _, waited in self._pace.waiting)
            self._part.factored(span, *self._damping(begin + span / 2))

    def _foreseen(
        self, force: Array, t: float, dt: float, limits: Limits, *, struck: bool = False
    ) -> tuple[Motion, Strained]:
        """The motion at the end of a step under a force, and what cells strain. Collective."""
        # While no window is known, the mean is over little more than a step.
        self._lag = LAG * limits.window if np.isfinite(limits.window) else dt
        steps = self._pace.stretches(force, dt)
        self._shorten(steps[0][1], t)
        motion = self._motion
        if self._grown:
            assert self._part is not None
            motion = motion.grown(self._grown, self._part.at_rest(force), dt)
        begin = t - sum(span for _, span in self._pace.waiting)
        found: Strained | None = None
        for mean, span in steps:
            start, motion = motion, self._stepped(motion, mean, begin + span / 2, span)
            found = self._gauge.strained(start, motion, span, limits, found, struck=struck)
            begin += span
        assert found is not None
        # Cells spring within a step, however long that of the shadows was.
        return motion, replace(found, spring=found.spring * (span / dt))

    def _take(
        self, motion: Motion, force: Array, dt: float, change: float, largest: Array, told: Array
    ) -> None:
        self._last = force, self._pace.stretches(force, dt)[-1][1]
        self._motion, self._grown, self.withheld = motion, [], float(told[0])
        self._energies += told[1:]
        self._pace.taken(force, change, *map(float, largest))

    def _shorten(self, span: float, t: float) -> None:
        """Have shadows go on in shorter steps than before, without what rings. Collective.

        What rings from one long step to the next would be a vibration that short ones follow. The
        middle of a step by the midpoint rule is the end of half a step by the backward Euler
        method, with the same factor, and another half, under the force at its end, takes the
        ringing out (R. Rannacher, Numer. Math. 43 (1984) 309-327).
        """
        force, before = self._last
        if span < before and not same_length(span, before):
            assert self._part is not None
            motion, damping = self._motion, self._damping(t - before / 2)
            u = motion.u - before / 2 * motion.w
            d = self._part.increment(force, u, motion.w, before, *damping)
            # The first step tells nothing by its rate, as that of a shadow that begins.
            w = np.full_like(u, np.nan)
            self._motion = replace(motion, u=u + d / 2, v=np.asarray(d / before), w=w)
            self._last = force, span

    def _damping(self, t: float) -> tuple[float, float]:
        """α of the drag on shadows [1/s], and ξ of the numerical damping."""
        acting = self._stepper.scene.acting(t)
        drag = sum(effect.mass_damping for effect in acting)
        return drag + 2 / self._settling, sum(e.numerical_damping or 0.0 for e in acting)

    def _stepped(self, motion: Motion, force: Array, t: float, dt: float) -> Motion:
        """The motion after a step. Collective."""
        assert self._part is not None
        still = self._part.at_rest(force)
        d = self._part.increment(force, motion.u, motion.v, dt, *self._damping(t))
        known = ~np.isnan(motion.mean)
        mean = np.where(
            known, motion.mean - np.expm1(-dt / self._lag) * (still - motion.mean), still
        )
        return Motion(motion.u + d, 2 / dt * d - motion.v, np.asarray(d / dt), still, mean)

    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        if self._accepting is not None:
            self._accepting()
        self._accepting = None
        self._bodies = attempt.increments.end

    def recovered(self) -> tuple[Array, Ints]:
        """K⁺ρ of the last step in space, and the owned cells that it is of. Collective.

        Returns:
            Displacements of the owned nodes, zero outside, shape (nodes, 3) [m]; cells.
        """
        out, u = np.zeros((self._stepper.scene.owned_nodes, 3)), self._at_rest()
        if self._margin is None or u is None:
            return out, np.empty(0, np.int32)
        parts = self._margin.parts
        return parts.in_space(parts.unmoved(u), self._stepper.state.bodies, out)

    def _at_rest(self) -> Array | None:
        """K⁺ρ of the last step in the bodies' frames; None if there is none. Collective."""
        if self._margin is None or self._part is None or self._pace.last is None:
            return None
        if self._withheld is not None:
            self._pace.last = self._withheld.exact(self._pace.last)
        return self._part.at_rest(self._pace.last)[self._margin.inside]

    def _release(self) -> None:
        for item in (self._withheld, self._part, self._mass):
            if item is not None:
                item.destroy()
        self._withheld, self._part, self._mass = None, None, None

    def destroy(self) -> None:
        """Free the PETSc objects; what bodies carry may still be asked for. Collective."""
        self._at_rest()
        part = self._part
        self._release()
        self._part = part
