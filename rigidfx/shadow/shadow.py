"""What rigid bodies would strain: a linear twin of each, carried along from step to step.

Two responses to the force that rigidity takes over tell what is withheld: the *shadow*

    M δ̈ + C δ̇ + K δ = ρ,    δ̇ = R ΔV at the freeze, the velocities that it took out of the motion,

which sees waves and resonance, and the response K⁺ρ to a load slower than the body, which sees what
a shadow that is damped does not. The larger of their strain rates is each cell's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from petsc4py import PETSc

from rigidfx.coupling.mass import Mass, mass_operator
from rigidfx.effects import MassDamping, NumericalDamping
from rigidfx.flexible.indicator import Indicator
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.shadow.linear_part import LinearPart
from rigidfx.shadow.parts import Parts
from rigidfx.shadow.withheld import Withheld
from rigidfx.step.stepper import Stepper

__all__ = ["Shadow", "Strains"]

Array = npt.NDArray[np.float64]


# What PETSc's log calls these parts of a run.
_REGROUPING = PETSc.Log.Event("rigidfxShadowNew")
_LOOKING = PETSc.Log.Event("rigidfxShadow")


@dataclass(frozen=True)
class Strains:
    """What the bodies withhold in a step, per owned cell; zero outside them.

    Attributes:
        rates: Strain rates [1/s].
        total: Strains since the freeze under loads slower than the body [1].
    """

    rates: Array
    total: Array


@dataclass
class Motion:
    """The motion of the shadows, in the bodies' frames, shape (nodes, 3).

    Attributes:
        u: δ [m].
        v: δ̇ [m/s].
        still: K⁺ρ of the last step [m]; NaN where there is none yet.
        mean: Its mean over the last two steps [m], in which forces that change their sign from step
            to step do not count; NaN likewise.
    """

    u: Array
    v: Array
    still: Array
    mean: Array


class Shadow:
    """The shadows of the bodies of a run; `destroy` frees the PETSc objects."""

    def __init__(self, stepper: Stepper, indicator: Indicator, settling: float) -> None:
        """Compile the forms. Collective.

        Args:
            stepper: Solves the steps.
            indicator: A measure of its own for the bodies' cells.
            settling: Time in which a drag takes the shadows' vibration out [s].
        """
        self._stepper, self._indicator = stepper, indicator
        self._linear = LinearForms(stepper.scene, stepper.forces)
        self._ends = fem.Function(stepper.scene.space), fem.Function(stepper.scene.space)
        self._settling = settling
        self._system: object = None
        self._bodies = Bodies.of_each(())  # of the last accepted step
        self._parts: Parts | None = None
        self._motion = self._next = Motion(*(np.empty((0, 3)) for _ in range(4)))
        self._grown: list[npt.NDArray[np.int64]] = []  # rows of bodies that have just grown
        self._mass: Mass | None = None
        self._part: LinearPart | None = None
        self._withheld: Withheld | None = None

    # Which bodies -------------------------------------------------------------------------------

    def _watched(self) -> list[RigidBody]:
        """The bodies with the mass and inertia of their cells."""
        return [body for body in self._stepper.state.bodies.of.records if not body.given]

    def follow(self, dt: float) -> None:
        """Have the shadows of the present bodies; their motion is carried over. Collective.

        Args:
            dt: Length of the present step [s].
        """
        stepper, old = self._stepper, self._parts
        if stepper.system is self._system:
            return
        self._system = stepper.system
        records = self._watched()
        if old is None or [*map(id, records)] != [*map(id, old.bodies)]:
            carried = self._carried()
            self._release()
            self._parts = Parts(stepper.scene, stepper.forces, records) if records else None
            if self._parts is not None:
                self._assemble(self._parts, dt)
                self._motion = self._adopted(self._parts, *carried)
        elif self._withheld is not None:
            self._withheld.destroy()
        if self._parts is not None:
            assert self._mass is not None
            self._withheld = Withheld(stepper, self._parts, self._mass, self._linear)
        self._bodies = stepper.state.bodies

    def _carried(self) -> tuple[set[int], Array]:
        """Which bodies have a shadow, and its motion in space, shape (5, owned nodes, 3).

        The last is the velocity of the bodies themselves; NaN where there is no shadow.
        """
        moved = np.full((5, self._stepper.scene.owned_nodes, 3), np.nan)
        if self._parts is None:
            return set(), moved
        of = dict(zip(map(id, self._parts.bodies), self._parts.at, strict=True))
        motion = self._motion
        for body in self._bodies:
            if id(body.data) in of:
                at, R = of[id(body.data)], body.motion.R
                fields = motion.u, motion.v, motion.still, motion.mean
                own = np.stack([field[at] for field in fields]) @ R.T
                moved[:, body.data.nodes] = [*own, body.velocities]
        return set(of), moved

    def _assemble(self, parts: Parts, dt: float) -> None:
        """Make matrices and factors, and take the shape over. Collective."""
        stepper, linear = self._stepper, self._linear
        linear.shape.x.array[parts.rows.dofs] = parts.shape
        linear.shape.x.scatter_forward()
        own = np.ones(parts.rows.nodes.size, dtype=bool)
        self._mass = mass_operator(stepper.scene, parts.rows, parts.cells, own)
        stepper.forces.set_rate(1.0)
        self._part = LinearPart(parts, self._mass, linear)
        stepper.forces.set_rate(1 / dt)
        self._ends[0].x.array[:] = linear.shape.x.array
        self._indicator.bind(parts.cells, self._ends)

    def _adopted(self, parts: Parts, before: set[int], moved: Array) -> Motion:
        """Motion of shadows that go on, and of those that begin. Collective.

        What is left of a body keeps its shadow. Where a body has grown, the new cells have seen it
        move rigidly: what its shadow did there would tear them. So that begins anew, at rest under
        the forces that act.
        """
        motion = Motion(*(np.zeros((parts.rows.nodes.size, 3)) for _ in range(4)))
        motion.still[:] = motion.mean[:] = np.nan
        bodies = {id(body.data): body for body in self._stepper.state.bodies}
        known = ~np.isnan(moved[0, :, 0])
        local = [[known[data.nodes].sum(), data.nodes.size] for data in parts.bodies]
        counts = np.reshape(self._stepper.scene.sum(np.array(local)), (-1, 2))
        self._grown = []
        for data, at, (old, every) in zip(parts.bodies, parts.at, counts, strict=True):
            body, here = bodies[id(data)], known[data.nodes, None]
            u, v, still, mean, whole = moved[:, data.nodes]
            if old < every:
                v = whole - body.velocities
                self._grown += [at] if old else []
            else:
                motion.u[at] = u @ body.motion.R
            motion.v[at] = np.where(here, v @ body.motion.R, _frozen_velocities(data))
            if id(data) in before:
                motion.still[at], motion.mean[at] = still @ body.motion.R, mean @ body.motion.R
        return motion

    # Steps --------------------------------------------------------------------------------------

    def look(self, t: float, dt: float) -> Strains | None:
        """What the bodies withhold in the step that has been solved; None without any. Collective.

        Args:
            t: Time at its start [s].
            dt: Its length [s].
        """
        with _REGROUPING:
            self.follow(dt)
        if self._parts is None:
            return None
        with _LOOKING:
            return self._strains(t, dt)

    def _strains(self, t: float, dt: float) -> Strains:
        assert self._withheld is not None
        assert self._part is not None
        force, motion = self._withheld.force(t, dt), self._motion
        scene = self._stepper.scene
        drag = sum(e.alpha for e in scene.named(MassDamping) if e.acts(t + dt / 2))
        xi = sum(e.xi for e in scene.named(NumericalDamping) if e.acts(t + dt / 2))
        still = self._part.at_rest(force)
        for at in self._grown:
            motion.u[at] = still[at]
        self._grown = []
        d = self._part.increment(force, motion.u, motion.v, dt, drag + 2 / self._settling, xi)
        mean = 0.5 * (still + motion.still)
        self._next = Motion(motion.u + d, 2 / dt * d - motion.v, still, mean)
        slow = np.nan_to_num(mean - motion.mean)
        rates = np.maximum(self._measured(d, dt), self._measured(slow, dt))
        return Strains(rates, self._measured(np.nan_to_num(mean), 1.0))

    def _measured(self, change: Array, dt: float) -> Array:
        """Strain rates of all owned cells, for a change of the frozen shape. Collective."""
        assert self._parts is not None
        shape, end = (f.x for f in self._ends)
        dofs = self._parts.rows.dofs
        end.array[:] = shape.array
        end.array[dofs] += change.reshape(-1)
        end.scatter_forward()
        self._indicator.measure(dt)
        return self._indicator.values.copy()

    def accept(self) -> None:
        """Take note that the step is one."""
        self._motion = self._next
        self._bodies = self._stepper.state.bodies

    # Life ---------------------------------------------------------------------------------------

    def _release(self) -> None:
        for item in (self._withheld, self._part, self._mass):
            if item is not None:
                item.destroy()
        self._withheld, self._part, self._mass = None, None, None

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._release()


def _frozen_velocities(body: RigidBody) -> Array:
    """What the freeze has taken out of the motion of the body's nodes [m/s]."""
    out = np.zeros((body.nodes.size, 3))
    own = np.isin(body.frozen.nodes, body.nodes)
    out[np.searchsorted(body.nodes, body.frozen.nodes[own])] = body.frozen.velocities[own]
    return out
