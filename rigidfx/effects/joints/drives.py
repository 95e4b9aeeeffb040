"""Motors, springs and stops of joints, bound: a multiplier and an equation each beside the rows.

A multiplier λ is the force along a coordinate q, over the joint's size ℓ where q is an angle. Its
equation is F = 0 [m],

    prescribed      ℓ (q₁ - q(t₁)) = 0
    a given force   (λ - f(t½)/ℓ)/κ = 0
    a law           (λ - f(q₀, q₁)/ℓ)/κ = 0        a spring with damper, a stop

with κ = 2 m/Δt² of the mass that the joint moves, in statics its stiffness. So stiff springs are no
stiffness of nodes. In statics forces are those at the end of a load step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from rigidfx.base.matrices import Matrix, Pattern
from rigidfx.base.types import Array, Ints
from rigidfx.effects.joints.elements import (
    Blow,
    JointSpring,
    Motor,
    Stop,
    coordinate_of,
    end_rates,
    titles_of,
)
from rigidfx.effects.joints.joint import Joint
from rigidfx.effects.joints.pieces import Coordinate, Coordinates

Element = Motor | JointSpring | Stop

APART = float(np.sqrt(np.sqrt(np.finfo(np.float64).eps)))  # of a large coordinate: a jump


@dataclass
class Drive:
    """A motor, spring or stop, with its title in reports.

    Attributes:
        number: Its number among them.
        key: Number of the joint, and name of the coordinate.
        averages: Numbers of its averages among those of all joints.
        size: ℓ, 1 of a travel [m].
        large: Size of the coordinate that counts as large, in its unit.
        wanted: q that is prescribed, at the start and at the end of the step.
        given: Its rate at both, each from within the step.
        known: That at the end of the step before; None if it has none.
        force: Force or torque that is given.
    """

    number: int
    effect: Any
    title: str
    key: tuple[int, str]
    coordinate: Coordinate
    averages: Ints
    size: float
    large: float
    wanted: tuple[float, float] | None = None
    given: tuple[float, float] | None = None
    known: float | None = None
    force: float = 0.0

    @property
    def unit(self) -> str:
        """Unit of the coordinate."""
        return "rad" if self.key[1] == "angle" else "m"


class Drives:
    """The motors and stops that act, and the springs, on the vectors of all joints.

    Attributes:
        static: Whether forces are those at the end of a step, and nothing moves.
        kappa: κ of each [N/m], set where a step begins.
        masses: Mass that each one's joint moves [kg].
        multipliers: λ of each at the last iterate [N].
        prescribed: Whether each prescribes its coordinate.
    """

    def __init__(
        self,
        scene: Any,
        elements: Sequence[Element],
        firsts: Sequence[int],
        count: int,
        static: bool,
    ) -> None:
        """Find the joints of those that act; `firsts` of `count` vectors are each joint's first."""
        self.static, self.kappa = static, np.ones(len(elements))
        joints, titles = (
            scene.named(Joint),
            {id(effect): title for effect, title in titles_of(scene)},
        )
        self.each: list[Drive] = []
        scales: list[tuple[float, float]] = []
        for n, effect in enumerate(elements):
            joint, name = coordinate_of(scene, effect.owner, effect.joint, effect.acts_along)
            k, pieces = joints.index(joint), joint.pieces
            of = pieces.coordinates[name]
            own = titles[id(effect)], (k, name), of, firsts[k] + np.array(of.averages)
            size, large = (pieces.size, 1.0) if name == "angle" else (1.0, pieces.size)
            scales.append((pieces.mass, pieces.size))
            self.each.append(Drive(n, effect, *own, size, large))
        self.masses, self.sizes = np.reshape(scales, (-1, 2)).T
        self._size = np.array([drive.size for drive in self.each])
        self._large = np.array([drive.large for drive in self.each])
        first = [firsts[drive.key[0]] for drive in self.each]
        self._coordinates = Coordinates([drive.coordinate for drive in self.each], first)
        self.prescribed = np.array([drive.effect.prescribes for drive in self.each], dtype=bool)
        self._motors = [drive for drive in self.each if isinstance(drive.effect, Motor)]
        self._springs = [drive for drive in self.each if not isinstance(drive.effect, Motor)]
        self._dt = 1.0
        self._q0: Mapping[tuple[int, str], float] = {}
        self._path: Array = np.zeros((len(elements), 2))  # q that is prescribed, as `wanted`
        self.multipliers: Array = np.zeros(len(elements))
        self._step: tuple[Array, Array] = np.zeros((0, 3)), np.zeros((0, 3))
        self._secants: tuple[Array, Array] | None = None  # of the last iterate, once needed
        self._laws: tuple[Array, Array] | None = None  # likewise
        at = (3 * self._coordinates.at[:, :, None] + np.arange(3)).reshape(-1, 9)
        rows, n = np.repeat(np.arange(len(elements)), 9), 3 * count
        self._pattern = Pattern(rows, at.ravel(), (len(elements), n))
        self._bent = Pattern(np.repeat(at, 9, axis=1).ravel(), np.tile(at, 9).ravel(), (n, n))

    def __len__(self) -> int:
        """How many there are."""
        return len(self.each)

    @property
    def averages(self) -> list[int]:
        """Numbers of the averages that they act on."""
        return [int(k) for drive in self.each for k in drive.averages]

    @property
    def prescribing(self) -> list[str]:
        """Names of those that prescribe a coordinate."""
        return [drive.effect.owner for drive in self.each if drive.effect.prescribes]

    def speeds(self, t: float, dt: float) -> Array:
        """Rates of F [m/s] that motors prescribe just after t; raise `SceneError` as `Motor.at`."""
        return np.array([-drive.size * drive.effect.speed_at(t, dt) for drive in self._motors])

    def apart(self, t: float, motors: Sequence[Motor]) -> list[str]:
        """Motors among some that are not where their joint is at t [s]; raise as `Motor.at`."""
        out = []
        for drive in self._motors:
            motor, q, unit = drive.effect, self._q0[drive.key], drive.unit
            if motor in motors and not motor.by_speed:
                wanted = motor.at(t)
                if abs(wanted - q) > APART * drive.large:
                    begun = f"{motor.owner} begins at t = {t:g} s with {motor.by} {wanted:.6g}"
                    out.append(f"{begun} {unit}, but the joint has {q:.6g} {unit} there")
        return out

    def beyond(self) -> list[str]:
        """Stops whose joint is beyond a limit at the start of a step, in words."""
        out = []
        for drive in self._springs:
            stop, q, unit = drive.effect, self._q0[drive.key], drive.unit
            if isinstance(stop, Stop) and abs(stop.beyond(q)) > APART * drive.large:
                low, high = stop.ends_at
                at = f"its {drive.key[1]} is {round(q, 9):g} {unit}, beyond {low:g} to {high:g}"
                out.append(f"{stop.owner}: {at} {unit}")
        return out

    @property
    def blows(self) -> dict[str, Blow]:
        """How each stop acts in the step, by its title."""
        out: dict[str, Blow] = {}
        for drive in self._springs:
            if isinstance(stop := drive.effect, Stop):
                (q0, q1), size = self.ends_of(drive), float(abs(self.multipliers[drive.number]))
                rests = 2 * abs(stop.beyond(q0)) > abs(stop.beyond(q1))
                blow = Blow(stop, size * drive.size, size, (q1 - q0) / self._dt, rests)
                out[drive.title] = blow
        return out

    def remember(self, notes: dict[int, Any]) -> None:
        """Keep the memory of earlier divisions."""
        for drive in self.each:
            if (known := notes.get(id(drive.effect))) is not None:
                self.multipliers[drive.number], wanted, drive.known = known
                drive.wanted = None if wanted is None else (wanted, wanted)

    def note(self, notes: dict[int, Any]) -> None:
        """Leave the memory for later divisions: λ, q that is prescribed at the end, its rate."""
        for drive in self.each:
            wanted = None if drive.wanted is None else drive.wanted[1]
            drive.known = None if drive.given is None else drive.given[1]
            notes[id(drive.effect)] = float(self.multipliers[drive.number]), wanted, drive.known

    # In a step ------------------------------------------------------------------------------------

    def begin(self, t: float, dt: float, q: Mapping[tuple[int, str], float]) -> None:
        """Evaluate functions for a step from t on, at coordinates q; raise as `Motor.at`."""
        self._dt, self._q0 = dt, q
        for drive in self._motors:
            motor = drive.effect
            if not motor.prescribes:
                drive.force = motor.at(t + dt if self.static else t + 0.5 * dt)
                continue
            first, last = motor.at(t), motor.at(t + dt)
            if motor.by_speed:
                start = q[drive.key] if drive.wanted is None else self._begun(drive)
                drive.given = first, last
                mean = (first + last + 4 * motor.at(t + 0.5 * dt)) / 6
                drive.wanted = start, start + dt * mean
            else:
                drive.wanted = first, last
                if not self.static:
                    drive.given = end_rates(first, last, motor.at(t + 0.5 * dt), dt)
            self._path[drive.number] = drive.wanted

    def _begun(self, drive: Drive) -> float:
        """q that a speed has led to at the start of a step, which may be tried again."""
        assert drive.wanted is not None
        q = self._q0[drive.key]
        return min(drive.wanted, key=lambda wanted: abs(wanted - q))

    def begin_at(self, q: Mapping[tuple[int, str], float]) -> None:
        """Set coordinates at the start of a step, by joint and name."""
        self._q0 = q

    def efforts(self, multipliers: Array, joint: int) -> dict[str, float]:
        """Torque [N m] or force [N] of each on a joint of this number, by title, of these λ [N]."""
        own = (drive for drive in self.each if drive.key[0] == joint)
        return {drive.title: float(multipliers[drive.number]) * drive.size for drive in own}

    def look(self, start: Array, moved: Array, multipliers: Array) -> None:
        """See an iterate: vectors at the start, their increments, and λ."""
        self._step, self.multipliers = (start, moved), np.array(multipliers)
        self._secants = self._laws = None

    def _gradients(self, share: float) -> Array:
        """Derivatives of coordinates by their vectors after a part of the step."""
        start, moved = self._step
        return self._coordinates.gradients(start + share * moved)

    def _by_secants(self) -> tuple[Array, Array]:
        """∇̄q of each in the step, shape (drives, 3, 3), and q₁ - q₀."""
        if self._secants is None:
            self._secants = self._coordinates.secants(*self._step, self._large)
        return self._secants

    def ends_of(self, drive: Drive) -> tuple[float, float]:
        """q of one of them at the start of the step, and at the last iterate."""
        q0 = self._q0[drive.key]
        return q0, q0 + float(self._by_secants()[1][drive.number])

    def _by_laws(self) -> tuple[Array, Array]:
        """Force or torque on the second side that each law gives, and its derivative by q₁."""
        if self._laws is None:
            out: Array = np.zeros((len(self.each), 2))
            out[:, 0] = [drive.force for drive in self.each]
            for drive in self._springs:
                law, (q0, q1) = drive.effect, self.ends_of(drive)
                out[drive.number] = law.pull(q1) if self.static else law.law(q0, q1, self._dt)
            self._laws = out[:, 0], out[:, 1]
        return self._laws

    def residual(self) -> Array:
        """F of each, shape (drives,) [m]."""
        if not self.each:
            return self.multipliers
        before, after = self._path.T
        lag = before - [self._q0[drive.key] for drive in self.each]  # ends of other steps
        off = -self._size * (self._by_secants()[1] - (after - before) - lag)
        force = self._by_laws()[0]
        return np.where(self.prescribed, off, (self.multipliers - force / self._size) / self.kappa)

    def compliance(self) -> Array:
        """dF/dλ of each [m/N]."""
        return np.where(self.prescribed, 0.0, 1.0 / self.kappa)

    def stiffness(self) -> Array:
        """Stiffness of each that is a law, at the last iterate, over ℓ², shape (drives,) [N/m]."""
        out = np.zeros(len(self.each))
        for drive in self._springs:
            out[drive.number] = -drive.effect.pull(self.ends_of(drive)[1])[1] / drive.size**2
        return out

    def _filled(self, factors: Array, slopes: Array) -> Matrix:
        """A matrix of derivatives of coordinates by their vectors, times a factor of each."""
        return self._pattern.filled((factors[:, None, None] * slopes).ravel())

    def _in_step(self) -> Array:
        """Derivatives of coordinates along which forces act, shape (drives, 3, 3)."""
        return self._gradients(1.0) if self.static else self._by_secants()[0]

    def add_to(self, forces: Array) -> Array:
        """Add their forces at the last iterate to those on vectors, shape (vectors, 3) [N]."""
        if self.each:
            own = (-self._size * self.multipliers)[:, None, None] * self._in_step()
            np.add.at(forces, self._coordinates.at, own)
        return forces

    def test(self) -> Matrix:
        """Forces on vectors per λ, as a resistance, shape (drives, 3 · vectors)."""
        return self._filled(-self._size, self._in_step())

    def trial(self) -> Matrix:
        """Derivatives of F by vectors, likewise."""
        by_laws = -self._by_laws()[1] / (self._size * self.kappa)
        return self._filled(np.where(self.prescribed, -self._size, by_laws), self._gradients(1.0))

    def along(self, share: float) -> Matrix:
        """Derivatives of F by vectors after a part of the step, by the motion alone, likewise."""
        return self._filled(-self._size, self._gradients(share))

    def curvature(self) -> csr_array:
        """Derivative of forces by vectors in statics, shape (3 · vectors,) * 2 [N/m]."""
        start, moved = self._step
        factors = (-self._size * self.multipliers)[:, None, None]
        return self._bent.sparse((factors * self._coordinates.curvatures(start + moved)).ravel())

    @property
    def given(self) -> Array:
        """Change of F's rate that motors prescribe since the step before ended [m/s]."""
        out: Array = np.zeros(len(self.each))
        for drive in self.each:
            if drive.given is not None:
                first, last = drive.given
                change = last - (first if drive.known is None else drive.known)
                out[drive.number] = drive.size * change
        return out

    # After a step ---------------------------------------------------------------------------------

    def work(self) -> tuple[float, dict[str, float]]:
        """Work of motors in the step, and loss by dampers by their kind [J]."""
        done, taken = 0.0, dict[str, float]()
        for drive in self._motors:
            q0, q1 = self.ends_of(drive)
            done += float(self.multipliers[drive.number]) * drive.size * (q1 - q0)
        for drive in () if self.static else self._springs:
            if (law := drive.effect).damping:
                energy = law.taken(*self.ends_of(drive), self._dt)
                taken[law.kind] = taken.get(law.kind, 0.0) + energy
        return done, taken

    def stored(self, q: Mapping[tuple[int, str], float]) -> float:
        """Energy of springs and stops where coordinates are these [J]."""
        return float(sum(drive.effect.stored(q[drive.key]) for drive in self._springs))
