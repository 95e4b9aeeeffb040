"""How shadows move under forces: step by step, with kept factors, each in its body's frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.base.instants import same_length
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.shadow.dashpots import of_neighbours
from rigidfx.shadow.linear_part import LinearPart
from rigidfx.shadow.margin import Margin
from rigidfx.shadow.motion import Motion, at_rest
from rigidfx.shadow.pace import Stretch
from rigidfx.step.stepper import Stepper

__all__ = ["Response"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Part of a window over which K⁺ρ is meant before it has a rate: what is faster than that shadows
# see, and a body's response to it is none of a body at rest.
LAG = 0.25


class Response:
    """The motion of the shadows of some bodies; `destroy` frees the PETSc objects.

    Attributes:
        part: Their linear equations.
        motion: At the end of the last step that they have taken.
        grown: Rows of bodies that have just grown.
        lag: Time over which K⁺ρ is meant before it has a rate [s].
        resting: Whether nothing moves on any rank, and no force has acted.
    """

    def __init__(
        self, stepper: Stepper, margin: Margin, linear: LinearForms, settling: float, dt: float
    ) -> None:
        """Make matrices and factors, and take the shape over. Collective.

        Args:
            stepper: Solves the steps.
            margin: The bodies, and what gives way with them.
            linear: Forms; their shape becomes that of the bodies.
            settling: Time in which a drag takes the shadows' vibration out [s].
            dt: Length of the present step [s].
        """
        self._scene, self._margin, self._settling = stepper.scene, margin, settling
        linear.shape.x.array[:] = 0.0
        dashpots = of_neighbours(stepper, margin.rows, margin.beyond, linear)
        linear.shape.x.array[margin.rows.dofs] = margin.shape
        linear.shape.x.scatter_forward()
        stepper.forces.set_rate(1.0)
        self.part = LinearPart(margin, linear, dashpots)
        stepper.forces.set_rate(1 / dt)
        self.motion, self.lag = at_rest(margin.rows.nodes.size), np.inf
        self.grown: list[Ints] = []
        self.resting = True
        self._last: Stretch = (np.empty((0, 3)), 0.0)  # ρ of the last step, and its length
        self._shortened = False  # whether what rang in that has been taken out

    def begin(self, motion: Motion, grown: list[Ints], t: float, dt: float | None) -> None:
        """Go on from a motion. Collective.

        Args:
            motion: The motion.
            grown: Rows of bodies that have just grown.
            t: Time [s].
            dt: Length of the present step, where what rings from step to step, and would become
                displacements of other cells, is to be left out [s]; None where nothing does.
        """
        self.motion, self.grown = motion, grown
        moves = bool(motion.u.any() or motion.v.any())
        self.resting = not self._scene.comm.allreduce(moves, op=MPI.LOR)
        if dt is not None and not self.resting:
            motion.v = self.part.resolved(motion.v, dt, *self._damping(t + dt / 2))

    def mean_over(self, window: float, dt: float) -> None:
        """Take the mean of K⁺ρ over a part of a window [s], or of a step while none is known."""
        self.lag = LAG * window if np.isfinite(window) else dt

    def factor(self, t: float, dt: float) -> None:
        """Have the factors for a step from t [s], of length dt [s]. Collective."""
        self.part.factored(dt, *self._damping(t + dt / 2))

    def rests(self, force: Array, before: Array | None, change: float) -> bool:
        """Whether all stays at rest in the present step: it need not be solved. Collective.

        Args:
            force: ρ of the step [N].
            before: That of the last one; None if there is none.
            change: Size of the change.
        """
        if self.resting and (change != 0 or before is None):
            self.resting = not self._scene.comm.allreduce(bool(force.any()), op=MPI.LOR)
        if self.resting:
            self.motion, self.grown = at_rest(len(self.motion.u), known=True), []
        return self.resting

    def start(self, force: Array, dt: float) -> Motion:
        """The motion before a step of length dt [s] under a force. Collective."""
        if not self.grown:
            return self.motion
        return self.motion.grown(self.grown, self.part.strained(force), dt)

    def stepped(self, motion: Motion, force: Array, t: float, dt: float) -> Motion:
        """The motion after a step from t [s], of length dt [s], under a force. Collective."""
        still = self.part.at_rest(force)
        d = self.part.increment(force, motion.u, motion.v, dt, *self._damping(t + dt / 2))
        known = ~np.isnan(motion.mean)
        mean = np.where(
            known, motion.mean - np.expm1(-dt / self.lag) * (still - motion.mean), still
        )
        return Motion(motion.u + d, 2 / dt * d - motion.v, np.asarray(d / dt), still, mean)

    @property
    def moved(self) -> Array:
        """δ of the bodies' nodes, shape (nodes, 3) [m]."""
        return self.motion.u[self._margin.inside]

    def withheld(self, motion: Motion, force: Array, mean: Array) -> tuple[Array, Array]:
        """Strain energies that are withheld at the end of a step. Collective.

        Args:
            motion: The motion then.
            force: ρ of the last step [N].
            mean: Its mean over a long one, of which K⁺ρ is [N].

        Returns:
            Twice that of bodies with their margins, twice that of these alone, and ½ ρᵀK⁺ρ of each
            body; and of each the same with K⁺ρ of ρ itself, exact while loads keep their
            proportions, shape (bodies,) [J].
        """
        parts, still = self._margin.parts, motion.still[self._margin.inside]
        own = [parts.energies(f, still) for f in (force, mean)]
        told = np.asarray(self._scene.sum(np.concatenate([self.part.energies(), *own])))
        now, of_mean = np.split(told[2:], 2)
        sizes = np.divide(now**2, of_mean, out=np.zeros_like(now), where=of_mean > 0)
        return told[: 2 + now.size], sizes

    def take(self, motion: Motion, force: Array, dt: float) -> None:
        """Have taken a step of length dt [s] under a force."""
        self._last, self.motion, self.grown = (force, dt), motion, []
        self._shortened = False

    def catch_up(self, stretches: list[Stretch], t: float) -> None:
        """Take the steps that calm shadows have not taken, up to t [s]. Collective."""
        begin = t - sum(span for _, span in stretches)
        for force, span in stretches:
            self.shorten(span, begin)
            self.motion = self.stepped(self.motion, force, begin, span)
            begin += span

    def shorten(self, span: float, t: float) -> None:
        """Have shadows go on in shorter steps than before, without what rings. Collective.

        What rings from one long step to the next would be a vibration that short ones follow. The
        middle of a step by the midpoint rule is the end of half a step by the backward Euler
        method, with the same factor, and another half, under the force at its end, takes the
        ringing out (R. Rannacher, Numer. Math. 43 (1984) 309-327).

        Args:
            span: Length of the steps to come [s].
            t: Time [s].
        """
        force, before = self._last
        if not self._shortened and span < before and not same_length(span, before):
            motion, damping = self.motion, self._damping(t - before / 2)
            u = motion.u - before / 2 * motion.w
            d = self.part.increment(force, u, motion.w, before, *damping)
            # The first step tells nothing by its rate, as that of a shadow that begins.
            w = np.full_like(u, np.nan)
            self.motion = replace(motion, u=u + d / 2, v=np.asarray(d / before), w=w)
            self._shortened = True  # however short a step is tried next, until one is taken

    def _damping(self, t: float) -> tuple[float, float]:
        """α of the drag on shadows [1/s], and ξ of the numerical damping."""
        drag, xi = self._scene.damping(t)
        return drag + 2 / self._settling, xi

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self.part.destroy()
