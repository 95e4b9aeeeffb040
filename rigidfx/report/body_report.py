"""The report of a body, rigid or with shapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rigidfx.base.types import Array
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body
from rigidfx.mechanics.rotation import skew

__all__ = ["BodyReport", "body_reports"]


@dataclass(frozen=True)
class BodyReport:
    """A body at one time, rigid or with shapes.

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
        stored: Energy that it keeps for its release; none if it has shapes [J].
        strain: Strain energy of a body with shapes [J].
        q: Coordinates of its shapes, shape (shapes,) [m].
        q_rate: Their rates, likewise [m/s].
        nu: ν, by which part of its strain energy that of its cells differed from it, of a body with
            shapes, when last looked at: the energy is at most ten times as large since.
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
    strain: float
    q: Array
    q_rate: Array
    nu: float
    inertia_ratio: float
    kinetic_excess: float

    @property
    def shapes(self) -> int:
        """Number of its shapes."""
        return len(self.q)


def body_reports(bodies: Bodies, nu: Mapping[str, float]) -> tuple[BodyReport, ...]:
    """Reports of the bodies at an instant.

    Args:
        bodies: The bodies.
        nu: ν of bodies with shapes, by their names; zero of others.
    """
    spins, kinetic = bodies.angular_momentum, bodies.kinetic_of_each
    strain = bodies.strain_of_each
    each = enumerate(bodies)
    return tuple(
        _body_report(b, spins[k], float(kinetic[k]), float(strain[k]), nu.get(b.data.name, 0.0))
        for k, b in each
    )


def _body_report(body: Body, own: Array, kinetic: float, strain: float, nu: float) -> BodyReport:
    """Report of a body with angular momentum [kg m²/s], kinetic and strain energy [J], and ν."""
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
        stored=data.frozen.energy if data.shapes is None else 0.0,
        strain=strain,
        q=motion.q,
        q_rate=motion.q_rate,
        nu=nu,
        inertia_ratio=data.inertia_ratio,
        kinetic_excess=float(0.5 * W @ data.excess @ W),
    )
