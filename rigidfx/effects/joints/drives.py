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
from rigidfx.effects.joints.coordinates import Coordinate, Coordinates
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

__all__ = ["Drives", "Element"]

Element = Motor | JointSpring | Stop

APART = float(np.sqrt(np.sqrt(np.finfo(np.float64).eps)))  # of a large coordinate: a jump


@dataclass
class _Drive:
    """One of them.

    Attributes:
        effect: The effect.
        key: Number of the joint, and name of the coordinate.
        coordinate: The coordinate.
        averages: Numbers of its averages among those of all joints.
        size: ℓ, 1 of a travel [m].
        wanted: q that is prescribed, at the start and at the end of the step.
        given: Its rate at both, each from within the step.
        known: That at the end of the step before; None if it has none.
        force: Force or torque that is given.
    """

    effect: Element
    key: tuple[int, str]
    coordinate: Coordinate
    averages: Ints
    size: float
    wanted: tuple[float, float] | None = None
    given: tuple[float, float] | None = None
    known: float | None = None
    force: float = 0.0


class Drives:
    """The motors and stops that act, and the springs, on the averages of all joints.

    Attributes:
        static: Whether forces are those at the end of a step, and nothing moves.
        kappa: κ of each [N/m], set where a step begins.
        masses: Mass that each one's joint moves [kg].
        sizes: Size of each one's joint [m].
        multipliers: λ of each at the last iterate [N].
        prescribed: Whether each prescribes its coordinate.
    """

    def __init__(
        self,
        scene: Any,
        elements: Sequence[Element],
        firsts: Sequence[int],
        static: bool = False,
    ) -> None:
        """Find their joints.

        Args:
            scene: The problem.
            elements: Those that act.
            firsts: Number of each joint's first average.
            static: Whether forces are those at the end of a step.
        """
        self.static, self.kappa = static, np.ones(len(elements))
        joints = scene.named(Joint)
        self._titles = {id(effect): title for effect, title in titles_of(scene)}
        self._all: list[_Drive] = []
        sizes: list[tuple[float, float, float, float]] = []
        for effect in elements:
            joint, name = coordinate_of(scene, effect.owner, effect.joint, effect.acts_along)
            k, pieces = joints.index(joint), joint.pieces
            of = pieces.coordinates[name]
            numbers = firsts[k] + np.array(of.averages)
            size, large = (pieces.size, 1.0) if name == "angle" else (1.0, pieces.size)
            sizes.append((size, large, pieces.mass, pieces.size))
            self._all.append(_Drive(effect, (k, name), of, numbers, size))
        # ℓ, and the size of a coordinate that counts as large, in its unit.
        self._size, self._large, self.masses, self.sizes = np.reshape(sizes, (-1, 4)).T
        first = [firsts[drive.key[0]] for drive in self._all]
        self._coordinates = Coordinates([drive.coordinate for drive in self._all], first)
        self.prescribed = np.array([drive.effect.prescribes for drive in self._all], dtype=bool)
        every = [(n, drive, drive.effect) for n, drive in enumerate(self._all)]
        self._motors = [(n, d, motor) for n, d, motor in every if isinstance(motor, Motor)]
        self._springs = [(n, d, law) for n, d, law in every if not isinstance(law, Motor)]
        self._dt = 1.0
        self._q0: Mapping[tuple[int, str], float] = {}
        self._path: Array = np.zeros((len(elements), 2))  # q that is prescribed, as `wanted`
        self.multipliers: Array = np.zeros(len(elements))
        self._start: Array = np.zeros((0, 3))  # averages at the start of the step ...
        self._moved: Array = np.zeros((0, 3))  # ... and their increments at the last iterate
        self._secants: tuple[Array, Array] | None = None  # of that iterate, once asked for
        self._laws: tuple[Array, Array] | None = None  # likewise
        self._pattern: Pattern | None = None

    def __len__(self) -> int:
        """How many there are."""
        return len(self._all)

    @property
    def each(self) -> tuple[_Drive, ...]:
        """All of them."""
        return tuple(self._all)

    @property
    def averages(self) -> list[int]:
        """Numbers of the averages that they act on."""
        return [int(k) for drive in self._all for k in drive.averages]

    @property
    def prescribing(self) -> list[str]:
        """Names of those that prescribe a coordinate."""
        return [d.effect.owner for d in self._all if d.effect.prescribes]

    def speeds(self, t: float, dt: float) -> Array:
        """Rates of change of F that motors prescribe just after t, shape (drives,) [m/s].

        Args:
            t: Time [s].
            dt: See `Motor.speed_at`.

        Raises:
            SceneError: On this rank, if a function cannot be used.
        """
        return np.array([-d.size * motor.speed_at(t, dt) for _, d, motor in self._motors])

    def apart(self, t: float, motors: Sequence[Motor]) -> list[str]:
        """Motors among some whose angle or travel at t [s] is not that of their joint, in words.

        Raises:
            SceneError: On this rank, if a function cannot be used.
        """
        out = []
        for n, drive, motor in self._motors:
            if motor not in motors or motor.by_speed:
                continue
            if abs(motor.at(t) - (q := self._q0[drive.key])) > APART * self._large[n]:
                unit = "rad" if motor.by == "angle" else "m"
                begun = f"{motor.owner} begins at t = {t:g} s with {motor.by} {motor.at(t):.6g}"
                out.append(f"{begun} {unit}, but the joint has {q:.6g} {unit} there")
        return out

    def beyond(self) -> list[str]:
        """Stops whose joint is beyond a limit at the start of a step, in words."""
        out = []
        for n, drive, stop in self._springs:
            q = self._q0[drive.key]
            if isinstance(stop, Stop) and abs(stop.beyond(q)) > APART * self._large[n]:
                unit = "rad" if drive.key[1] == "angle" else "m"
                low, high = stop.ends_at
                at = f"its {drive.key[1]} is {round(q, 9):g} {unit}, beyond {low:g} to {high:g}"
                out.append(f"{stop.owner}: {at} {unit}")
        return out

    @property
    def blows(self) -> dict[str, Blow]:
        """How each stop acts in the step, by its title."""
        out: dict[str, Blow] = {}
        for n, drive, stop in self._springs:
            if isinstance(stop, Stop):
                (q0, q1), size = self.ends_of(n), float(abs(self.multipliers[n]))
                rests = 2 * abs(stop.beyond(q0)) > abs(stop.beyond(q1))
                blow = Blow(stop, size * drive.size, size, (q1 - q0) / self._dt, rests)
                out[self._titles[id(stop)]] = blow
        return out

    def remember(self, notes: dict[int, Any]) -> None:
        """Take over the memory of earlier divisions."""
        for n, drive in enumerate(self._all):
            known = notes.get(id(drive.effect))
            if known is not None:
                self.multipliers[n], wanted, drive.known = known
                drive.wanted = None if wanted is None else (wanted, wanted)

    def note(self, notes: dict[int, Any]) -> None:
        """Leave the memory for later divisions: λ, q that is prescribed at the end, its rate."""
        for drive, multiplier in zip(self._all, map(float, self.multipliers), strict=True):
            wanted = None if drive.wanted is None else drive.wanted[1]
            drive.known = None if drive.given is None else drive.given[1]
            notes[id(drive.effect)] = multiplier, wanted, drive.known

    # In a step ------------------------------------------------------------------------------------

    def begin(self, t: float, dt: float, q: Mapping[tuple[int, str], float]) -> None:
        """Evaluate functions of time for a step from t on [s].

        Args:
            t: Its start.
            dt: Its length.
            q: Coordinates at its start, by joint and name.

        Raises:
            SceneError: On this rank, if a function cannot be used.
        """
        self._dt, self._q0 = dt, q
        for n, drive, motor in self._motors:
            if motor.by in ("angle", "travel"):
                drive.wanted = motor.at(t), motor.at(t + dt)
                if not self.static:
                    drive.given = end_rates(*drive.wanted, motor.at(t + 0.5 * dt), dt)
            elif motor.prescribes:
                start = q[drive.key] if drive.wanted is None else self._begun(drive)
                drive.given = motor.at(t), motor.at(t + dt)
                mean = (sum(drive.given) + 4 * motor.at(t + 0.5 * dt)) / 6
                drive.wanted = start, start + dt * mean
            else:
                drive.force = motor.at(t + dt if self.static else t + 0.5 * dt)
            if drive.wanted is not None:
                self._path[n] = drive.wanted

    def _begun(self, drive: _Drive) -> float:
        """q that a speed has led to at the start of a step, which may be tried again."""
        assert drive.wanted is not None
        first, last = drive.wanted
        q = self._q0[drive.key]
        return first if abs(first - q) <= abs(last - q) else last

    def begin_at(self, q: Mapping[tuple[int, str], float]) -> None:
        """Take coordinates at the start of a step, by joint and name."""
        self._q0 = q

    def efforts(self, multipliers: Array, joint: int) -> dict[str, float]:
        """Torque [N m] or force [N] of each that acts on a joint, by its title.

        Args:
            multipliers: λ of each [N].
            joint: Number of the joint.
        """
        every = zip(self._all, multipliers, strict=True)
        own = ((drive, value) for drive, value in every if drive.key[0] == joint)
        return {self._titles[id(d.effect)]: float(value) * d.size for d, value in own}

    def look(self, start: Array, moved: Array, multipliers: Array) -> None:
        """See an iterate: averages at the start, their increments, and λ."""
        self._start, self._moved, self.multipliers = start, moved, np.array(multipliers)
        self._secants = self._laws = None

    def _by_secants(self) -> tuple[Array, Array]:
        """∇̄q of each in the step, shape (drives, 3, 3), and q₁ - q₀."""
        if self._secants is None:
            step = self._start, self._moved, self._large
            self._secants = self._coordinates.secants(*step)
        return self._secants

    def ends_of(self, n: int) -> tuple[float, float]:
        """q of one of them at the start of the step, and at the last iterate."""
        q0 = self._q0[self._all[n].key]
        return q0, q0 + float(self._by_secants()[1][n])

    def _by_laws(self) -> tuple[Array, Array]:
        """Force or torque on the second side that each law gives, and its derivative by q₁."""
        if self._laws is None:
            out: Array = np.zeros((len(self._all), 2))
            out[:, 0] = [drive.force for drive in self._all]
            for n, _, law in self._springs:
                q0, q1 = self.ends_of(n)
                out[n] = law.pull(q1) if self.static else law.law(q0, q1, self._dt)
            self._laws = out[:, 0], out[:, 1]
        return self._laws

    def residual(self) -> Array:
        """F of each, shape (drives,) [m]."""
        if not self._all:
            return self.multipliers
        before, after = self._path.T
        lag = before - [self._q0[drive.key] for drive in self._all]  # ends of other steps
        off = -self._size * (self._by_secants()[1] - (after - before) - lag)
        force = self._by_laws()[0]
        return np.where(self.prescribed, off, (self.multipliers - force / self._size) / self.kappa)

    def compliance(self) -> Array:
        """dF/dλ of each [m/N]."""
        return np.where(self.prescribed, 0.0, 1.0 / self.kappa)

    def stiffness(self) -> Array:
        """Stiffness of each that is a law, at the last iterate, over ℓ², shape (drives,) [N/m]."""
        out = np.zeros(len(self._all))
        for n, drive, law in self._springs:
            out[n] = -law.pull(self.ends_of(n)[1])[1] / drive.size**2
        return out

    def _rows(self, values: Array, columns: int) -> Matrix:
        """A matrix of values of drives at their averages, shape (drives, 3, 3)."""
        if self._pattern is None:
            n = len(self._all)
            every = (3 * self._coordinates.at[:, :, None] + np.arange(3)).ravel()
            self._pattern = Pattern(np.repeat(np.arange(n), 9), every, (n, columns))
        return self._pattern.filled(values.ravel())

    def _per_multiplier(self) -> Array:
        """Forces on their averages per λ, as a resistance, shape (drives, 3, 3)."""
        if self.static:
            slopes = self._coordinates.gradients(self._start + self._moved)
        else:
            slopes, _ = self._by_secants()
        return -self._size[:, None, None] * slopes

    def add_to(self, forces: Array) -> Array:
        """Add their forces at the last iterate to those on averages, shape (averages, 3) [N]."""
        if self._all:
            own = self.multipliers[:, None, None] * self._per_multiplier()
            np.add.at(forces, self._coordinates.at, own)
        return forces

    def test(self, columns: int) -> Matrix:
        """Forces on averages per λ, as a resistance, shape (drives, columns)."""
        return self._rows(self._per_multiplier(), columns)

    def trial(self, columns: int) -> Matrix:
        """Derivatives of F by averages, shape (drives, columns)."""
        by_laws = -self._by_laws()[1] / (self._size * self.kappa)
        factors = np.where(self.prescribed, -self._size, by_laws)
        gradients = self._coordinates.gradients(self._start + self._moved)
        return self._rows(factors[:, None, None] * gradients, columns)

    def curvature(self, columns: int) -> csr_array:
        """Derivative of forces by averages in statics, shape (columns,) * 2 [N/m]."""
        factors = -self._size * self.multipliers
        blocks = self._coordinates.curvatures(self._start + self._moved)
        at = (3 * self._coordinates.at[:, :, None] + np.arange(3)).reshape(-1, 9)
        where = np.repeat(at, 9, axis=1).ravel(), np.tile(at, 9).ravel()
        values = (factors[:, None, None] * blocks).ravel()
        return csr_array((values, where), shape=(columns, columns))

    def along(self, share: float, columns: int) -> Matrix:
        """Derivatives of F by averages after a part of the step, by the motion alone, likewise."""
        slopes = self._coordinates.gradients(self._start + share * self._moved)
        return self._rows(-self._size[:, None, None] * slopes, columns)

    @property
    def given(self) -> Array:
        """Change of F's rate that motors prescribe since the step before ended [m/s]."""
        out: Array = np.zeros(len(self._all))
        for n, drive in enumerate(self._all):
            if drive.given is not None:
                first, last = drive.given
                out[n] = drive.size * (last - (first if drive.known is None else drive.known))
        return out

    # After a step ---------------------------------------------------------------------------------

    def work(self) -> tuple[float, dict[str, float]]:
        """Work of motors in the step, and loss by dampers by their kind [J]."""
        done, taken = 0.0, dict[str, float]()
        for n, drive, _ in self._motors:
            q0, q1 = self.ends_of(n)
            done += float(self.multipliers[n]) * drive.size * (q1 - q0)
        for n, _, law in () if self.static else self._springs:
            if law.damping:
                energy = law.taken(*self.ends_of(n), self._dt)
                taken[law.kind] = taken.get(law.kind, 0.0) + energy
        return done, taken

    def stored(self, q: Mapping[tuple[int, str], float]) -> float:
        """Energy of springs and stops where coordinates are these [J]."""
        return float(sum(law.stored(q[drive.key]) for _, drive, law in self._springs))
