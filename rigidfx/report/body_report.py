"""The report of a rigid body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body
from rigidfx.mechanics.rotation import skew

__all__ = ["BodyReport", "body_reports"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class BodyReport:
    """A rigid body at one time.

    Attributes:
        name: Name of its set of cells, or "part" and its number.
        number: Its number ≥ 1, by which fields show it.
        cells: Number of its cells.
        mass: m [kg].
        centre: Position of the centre of mass, shape (3,) [m].
        orientation: Rotation R since it became rigid, shape (3, 3).
        velocity: Velocity of the centre of mass, shape (3,) [m/s].
        angular_velocity: ω in space, shape (3,) [rad/s].
        linear_momentum: m ṙ, shape (3,) [kg m/s].
        angular_momentum_about_centre: J ω, shape (3,) [kg m²/s].
        angular_momentum: Angular momentum about the origin, shape (3,) [kg m²/s].
        kinetic: Kinetic energy [J].
        stored: Energy that it keeps for its release [J].
        inertia_ratio: Largest ratio, about any axis, of its moment of inertia to the exact one of
            its cells: above 1 where masses are lumped.
        kinetic_excess: Kinetic energy that it has for this reason only [J].
    """

    name: str
    number: int
    cells: int
    mass: float
    centre: Array
    orientation: Array
    velocity: Array
    angular_velocity: Array
    linear_momentum: Array
    angular_momentum_about_centre: Array
    angular_momentum: Array
    kinetic: float
    stored: float
    inertia_ratio: float
    kinetic_excess: float


def body_reports(bodies: Bodies) -> tuple[BodyReport, ...]:
    """Reports of the bodies at an instant."""
    spins, kinetic = bodies.angular_momentum, bodies.kinetic_of_each
    each = enumerate(bodies)
    return tuple(_body_report(body, spins[k], float(kinetic[k])) for k, body in each)


def _body_report(body: Body, own: Array, kinetic: float) -> BodyReport:
    """Report of a body with angular momentum [kg m²/s] and kinetic energy [J]."""
    data, motion = body.data, body.motion
    W, momentum = motion.angular_velocity_body, data.mass * motion.velocity
    return BodyReport(
        name=data.name,
        number=data.number,
        cells=data.size,
        mass=data.mass,
        centre=motion.r,
        orientation=motion.R,
        velocity=motion.velocity,
        angular_velocity=motion.angular_velocity,
        linear_momentum=momentum,
        angular_momentum_about_centre=own,
        angular_momentum=skew(motion.r) @ momentum + own,
        kinetic=kinetic,
        stored=data.frozen.energy,
        inertia_ratio=data.inertia_ratio,
        kinetic_excess=float(0.5 * W @ data.excess @ W),
    )
