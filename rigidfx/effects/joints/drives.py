"""Motors, springs and stops of joints, bound: a multiplier and an equation each beside the rows.

A multiplier λ is the force along a coordinate q, over the joint's size ℓ where q is an angle. Its
equation F = 0 [m] is ℓ (q₁ - q(t₁)) = 0 where q is prescribed, (λ - f/ℓ)/κ = 0 with a given force
f̄ or a law f(q₀, q₁), with κ = 2 m/Δt² of the mass that the joint moves, in statics its
stiffness. So stiff springs are no stiffness of nodes.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from rigidfx.base.matrices import Matrix
from rigidfx.base.types import Array
from rigidfx.effects.base import mean_over
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
from rigidfx.effects.joints.pieces import Coordinates, Pieces
from rigidfx.effects.joints.remote import RemoteMotion, at_rest

Element = Motor | JointSpring | Stop

APART = float(np.sqrt(np.sqrt(np.finfo(np.float64).eps)))  # of a large coordinate: a jump


@dataclass
class Drive:
    """A motor, spring or stop, with its title in reports."""

    number: int  # among them
    effect: Any
    title: str
    key: tuple[int, str]  # number of the joint, and name of the coordinate
    joint: Pieces
    wanted: tuple[float, float] | None = None  # q that is prescribed at both ends of the step
    given: tuple[float, float] | None = None  # its rate at both, each from within the step
    known: float | None = None  # that at the end of the step before
    force: float = 0.0  # or torque, that is given

    @property
    def unit(self) -> str:
        """Unit of the coordinate."""
        return "rad" if self.key[1] == "angle" else "m"

    @property
    def size(self) -> float:
        """ℓ, 1 of a travel [m]."""
        return self.joint.size if self.key[1] == "angle" else 1.0

    @property
    def large(self) -> float:
        """Size of the coordinate that counts as large, in its unit."""
        return self.joint.size / self.size


class Drives:
    """The motors and stops that act, and the springs, on the vectors of all joints."""

    def __init__(
        self,
        scene: Any,
        elements: Sequence[Element],
        firsts: Sequence[int],
        count: int,
        static: bool,
    ) -> None:
        """Find the joints of those that act; `firsts` of `count` vectors are each joint's first."""
        joints = scene.named(Joint)
        titles = {id(effect): title for effect, title in titles_of(scene)}
        self.static, self.each = static, list[Drive]()
        for n, effect in enumerate(elements):
            joint, name = coordinate_of(scene, effect.owner, effect.joint, effect.acts_along)
            key = joints.index(joint), name
            self.each.append(Drive(n, effect, titles[id(effect)], key, joint.pieces))
        self._motors = [drive for drive in self.each if isinstance(drive.effect, Motor)]
        self._springs = [drive for drive in self.each if not isinstance(drive.effect, Motor)]
        self._stops = [drive for drive in self._springs if isinstance(drive.effect, Stop)]
        self.masses = self._all(lambda drive: drive.joint.mass)  # that each one's joint moves [kg]
        self.sizes = self._all(lambda drive: drive.joint.size)  # of each one's joint [m]
        self._size, self._large = self._all(lambda d: d.size), self._all(lambda d: d.large)
        self.prescribed = self._all(lambda drive: drive.effect.prescribes).astype(bool)
        self.kappa = np.ones(len(elements))  # κ of each [N/m], set where a step begins
        self.multipliers: Array = np.zeros(len(elements))  # λ of each at the last iterate [N]
        of = [drive.joint.coordinates[drive.key[1]] for drive in self.each]
        self._coordinates = Coordinates(of, [firsts[drive.key[0]] for drive in self.each], count)
        self.averages = self._coordinates.averages  # numbers of those that they act on
        self._q0: Mapping[tuple[int, str], float] = {}
        self._motion = at_rest(np.zeros((count, 3)))
        self._mean: Array = np.zeros((2, len(elements)))  # secants of each at the last iterate
        self._gained: Array = np.zeros(len(elements))  # q₁ - q₀ likewise

    def __len__(self) -> int:
        return len(self.each)

    def _all(self, number: Callable[[Drive], float]) -> Array:
        """A number of each."""
        return np.array([number(drive) for drive in self.each], dtype=np.float64)

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
        for drive in self._stops:
            stop, q, unit = drive.effect, self._q0[drive.key], drive.unit
            if abs(stop.beyond(q)) > APART * drive.large:
                low, high = stop.ends_at
                at = f"its {drive.key[1]} is {round(q, 9):g} {unit}, beyond {low:g} to {high:g}"
                out.append(f"{stop.owner}: {at} {unit}")
        return out

    @property
    def blows(self) -> dict[str, Blow]:
        """How each stop acts in the step, by its title."""
        out: dict[str, Blow] = {}
        for drive in self._stops:
            (q0, q1), force = self.ends_of(drive), float(abs(self.multipliers[drive.number]))
            pressed = 2 * abs(drive.effect.beyond(q0)) > abs(drive.effect.beyond(q1))
            rate = (q1 - q0) / self._motion.dt
            out[drive.title] = Blow(drive.effect, force * drive.size, force, rate, pressed)
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

    def set_time(self, t: float, dt: float, q: Mapping[tuple[int, str], float]) -> None:
        """Evaluate functions for a step from t on, at coordinates q; raise as `Motor.at`."""
        self._q0 = q
        for drive in self._motors:
            motor = drive.effect
            if not motor.prescribes:
                end = (t + dt, 0.0) if self.static else (t + 0.5 * dt, dt)
                drive.force = mean_over(motor.at, *end)
                continue
            first, last = motor.at(t), motor.at(t + dt)
            if motor.by_speed:
                # The speeds may have led there, in a step that is tried again.
                before = (q[drive.key],) if drive.wanted is None else drive.wanted
                start = min(before, key=lambda wanted: abs(wanted - q[drive.key]))
                drive.given = first, last
                drive.wanted = start, start + dt * (first + last + 4 * motor.at(t + 0.5 * dt)) / 6
            else:
                drive.wanted = first, last
                if not self.static:
                    drive.given = end_rates(first, last, motor.at(t + 0.5 * dt), dt)

    def begin(self, q: Mapping[tuple[int, str], float], at: RemoteMotion) -> None:
        """Begin a step where coordinates are q, by joint and name, and vectors are at a place."""
        self._q0 = q
        self.look(at, self.multipliers)

    def efforts(self, multipliers: Array, joint: int) -> dict[str, float]:
        """Torque [N m] or force [N] of each on a joint of this number, by title, of these λ [N]."""
        own = (drive for drive in self.each if drive.key[0] == joint)
        return {drive.title: float(multipliers[drive.number]) * drive.size for drive in own}

    def look(self, motion: RemoteMotion, multipliers: Array) -> None:
        """See an iterate of the vectors, and λ."""
        self._motion, self.multipliers = motion, np.array(multipliers)
        secants = self._coordinates.secants(motion.places, motion.moved, self._large)
        self._mean, self._gained = secants

    def ends_of(self, drive: Drive) -> tuple[float, float]:
        """q of one of them at the start of the step, and at the last iterate."""
        q0 = self._q0[drive.key]
        return q0, q0 + float(self._gained[drive.number])

    def _laws(self) -> tuple[Array, Array]:
        """Force or torque on the second side that each law gives, and its derivative by q₁."""
        out: Array = np.zeros((2, len(self.each)))
        out[0] = self._all(lambda drive: drive.force)
        for drive in self._springs:
            law, (q0, q1) = drive.effect, self.ends_of(drive)
            out[:, drive.number] = (
                law.pull(q1) if self.static else law.law(q0, q1, self._motion.dt)
            )[:2]
        return out[0], out[1]

    def residual(self) -> Array:
        """F of each, shape (drives,) [m]."""
        if not self.each:
            return self.multipliers
        paths = np.array([drive.wanted or (0.0, 0.0) for drive in self.each])
        lag = paths[:, 0] - [self._q0[drive.key] for drive in self.each]  # ends of other steps
        off = -self._size * (self._gained - np.diff(paths)[:, 0] - lag)
        force = self._laws()[0]
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

    def _in_step(self) -> tuple[Array, Array]:
        """Derivatives by invariants along which forces act, and where vectors are then."""
        p = self._motion.after(1.0 if self.static else 0.5)
        return self._coordinates.slopes(p) if self.static else self._mean, p

    def add_to(self, forces: Array) -> None:
        """Add their forces at the last iterate to those on vectors, shape (vectors, 3) [N]."""
        slopes, p = self._in_step()
        forces += self._coordinates.forces(p, (-self._size * self.multipliers * slopes).ravel())

    def test(self) -> Matrix:
        """Forces on vectors per λ, as a resistance, shape (drives, 3 · vectors)."""
        slopes, p = self._in_step()
        return self._coordinates.chained(-self._size * slopes, p)

    def trial(self) -> Matrix:
        """Derivatives of F by vectors, likewise."""
        by_laws = -self._laws()[1] / (self._size * self.kappa)
        return self._chained(np.where(self.prescribed, -self._size, by_laws), 1.0)

    def along(self, share: float) -> Matrix:
        """Derivatives of F by vectors after a part of the step, by the motion alone, likewise."""
        return self._chained(-self._size, share)

    def _chained(self, factors: Array, share: float) -> Matrix:
        p = self._motion.after(share)
        return self._coordinates.chained(factors * self._coordinates.slopes(p), p)

    def curvature(self) -> csr_array:
        """Derivative of forces by vectors in statics, shape (3 · vectors,) * 2 [N/m]."""
        return self._coordinates.bent(self._motion.after(1.0), -self._size * self.multipliers)

    @property
    def given(self) -> Array:
        """Change of F's rate that motors prescribe since the step before ended [m/s]."""

        def change(drive: Drive) -> float:
            first, last = drive.given or (0.0, 0.0)
            before = first if drive.given is None or drive.known is None else drive.known
            return drive.size * (last - before)

        return self._all(change)

    # After a step ---------------------------------------------------------------------------------

    def work(self) -> tuple[float, list[tuple[str, float]]]:
        """Work of motors in the step, and loss by each damper with its kind [J]."""
        efforts = self.multipliers * self._size
        done = sum(float(efforts[d.number] * self._gained[d.number]) for d in self._motors)
        dampers = [d for d in self._springs if d.effect.damping and not self.static]
        each = ((d.effect, d.effect.law(*self.ends_of(d), self._motion.dt)) for d in dampers)
        return done, [(effect.kind, energy) for effect, (_, _, energy) in each]

    def stored(self, q: Mapping[tuple[int, str], float]) -> float:
        """Energy of springs and stops where coordinates are these [J]."""
        return float(sum(drive.effect.stored(q[drive.key]) for drive in self._springs))
