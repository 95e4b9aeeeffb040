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
import numpy.typing as npt
from scipy.sparse import csr_array

from rigidfx.effects.joints.coordinates import Coordinate, secant
from rigidfx.effects.joints.elements import JointSpring, Motor, coordinate_of, titles_of
from rigidfx.effects.joints.joint import Joint
from rigidfx.effects.joints.stop import Stop

__all__ = ["Drives", "Element", "prescribes"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
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
        large: Size of the coordinate that counts as large, in its unit.
        mass: Mass that the joint moves, in order of magnitude [kg].
        joint_size: Size of the joint [m].
        wanted: q that is prescribed, at the start and at the end of the step.
        force: Force or torque that is given.
        multiplier: λ of the last iterate [N].
    """

    effect: Element
    key: tuple[int, str]
    coordinate: Coordinate
    averages: Ints
    size: float
    large: float
    mass: float
    joint_size: float
    wanted: tuple[float, float] | None = None
    force: float = 0.0
    multiplier: float = 0.0


class Drives:
    """The motors and stops that act, and the springs, on the averages of all joints.

    Attributes:
        static: Whether forces are those at the end of a step, and nothing moves.
        kappa: κ of each [N/m], set where a step begins.
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
        for effect in elements:
            joint, name = coordinate_of(scene, effect.owner, effect.joint, effect.acts_along)
            k, pieces = joints.index(joint), joint.pieces
            of = pieces.coordinates[name]
            numbers = firsts[k] + np.array(of.averages)
            size, large = (pieces.size, 1.0) if name == "angle" else (1.0, pieces.size)
            own = size, large, pieces.mass, pieces.size
            self._all.append(_Drive(effect, (k, name), of, numbers, *own))
        self._dt = 1.0
        self._q0: Mapping[tuple[int, str], float] = {}
        none: Array = np.zeros((0, 3))
        self._start = self._moved = none

    def __len__(self) -> int:
        """How many there are."""
        return len(self._all)

    @property
    def each(self) -> tuple[_Drive, ...]:
        """All of them."""
        return tuple(self._all)

    @property
    def masses(self) -> Array:
        """Mass that each one's joint moves [kg]."""
        return np.array([drive.mass for drive in self._all], dtype=np.float64)

    @property
    def sizes(self) -> Array:
        """Size of each one's joint [m]."""
        return np.array([drive.joint_size for drive in self._all], dtype=np.float64)

    @property
    def multipliers(self) -> Array:
        """λ of each [N]."""
        return np.array([drive.multiplier for drive in self._all], dtype=np.float64)

    @property
    def averages(self) -> list[int]:
        """Numbers of the averages that they act on."""
        return [int(k) for drive in self._all for k in drive.averages]

    @property
    def prescribing(self) -> list[str]:
        """Names of those that prescribe a coordinate."""
        return [d.effect.owner for d in self._all if prescribes(d.effect)]

    def speeds(self, t: float, dt: float) -> Array:
        """Rates of change of F that motors prescribe just after t, shape (drives,) [m/s].

        Args:
            t: Time [s].
            dt: See `Motor.speed_at`.

        Raises:
            SceneError: On this rank, if a function cannot be used.
        """
        given = [(d.size, d.effect) for d in self._all if isinstance(d.effect, Motor)]
        return np.array([-size * motor.speed_at(t, dt) for size, motor in given], dtype=float)

    def apart(self, t: float, motors: Sequence[Motor]) -> list[str]:
        """Motors among some whose angle or travel at t [s] is not that of their joint, in words.

        Raises:
            SceneError: On this rank, if a function cannot be used.
        """
        out = []
        for drive in self._all:
            motor, q = drive.effect, self._q0[drive.key]
            if not isinstance(motor, Motor) or motor not in motors or motor.by_speed:
                continue
            if abs(motor.at(t) - q) > APART * drive.large:
                unit = "rad" if motor.by == "angle" else "m"
                begun = f"{motor.owner} begins at t = {t:g} s with {motor.by} {motor.at(t):.6g}"
                out.append(f"{begun} {unit}, but the joint has {q:.6g} {unit} there")
        return out

    def remember(self, notes: dict[int, Any]) -> None:
        """Take over the memory of earlier divisions."""
        for drive in self._all:
            known = notes.get(id(drive.effect))
            if known is not None:
                drive.multiplier, wanted = known
                drive.wanted = None if wanted is None else (wanted, wanted)

    def note(self, notes: dict[int, Any]) -> None:
        """Leave the memory for later divisions: λ, and q that is prescribed at the end."""
        for drive in self._all:
            wanted = None if drive.wanted is None else drive.wanted[1]
            notes[id(drive.effect)] = drive.multiplier, wanted

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
        for drive in self._all:
            motor = drive.effect
            if not isinstance(motor, Motor):
                continue
            if motor.by in ("angle", "travel"):
                drive.wanted = motor.at(t), motor.at(t + dt)
            elif motor.prescribes:
                start = q[drive.key] if drive.wanted is None else self._begun(drive)
                ends = motor.at(t) + 4 * motor.at(t + 0.5 * dt) + motor.at(t + dt)
                drive.wanted = start, start + dt / 6 * ends
            else:
                drive.force = motor.at(t + dt if self.static else t + 0.5 * dt)

    def _begun(self, drive: _Drive) -> float:
        """q that a speed has led to at the start of a step, which may be tried again."""
        assert drive.wanted is not None
        first, last = drive.wanted
        q = self._q0[drive.key]
        return first if abs(first - q) <= abs(last - q) else last

    def begin_at(self, q: Mapping[tuple[int, str], float]) -> None:
        """Take coordinates at the start of a step, by joint and name."""
        self._q0 = q

    def efforts(self) -> dict[int, dict[str, float]]:
        """Torque [N m] or force [N] of each, by number of its joint and its title."""
        out: dict[int, dict[str, float]] = {}
        for drive in self._all:
            title = self._titles[id(drive.effect)]
            out.setdefault(drive.key[0], {})[title] = drive.multiplier * drive.size
        return out

    def look(self, start: Array, moved: Array, multipliers: Array) -> None:
        """See an iterate: averages at the start, their increments, and λ."""
        self._start, self._moved = start, moved
        for drive, value in zip(self._all, multipliers, strict=True):
            drive.multiplier = float(value)

    def ends(self, drive: _Drive) -> tuple[float, float]:
        """q at the start and the end of the step."""
        q0 = self._q0[drive.key]
        p = self._start[drive.averages] + self._moved[drive.averages]
        return q0, drive.coordinate.continued(drive.coordinate.value(p), q0)

    def _law(self, drive: _Drive) -> tuple[float, float]:
        """Force or torque on the second side that a law gives, and its derivative by q₁."""
        effect, (q0, q1) = drive.effect, self.ends(drive)
        if isinstance(effect, Motor):
            return drive.force, 0.0
        return effect.pull(q1) if self.static else effect.law(q0, q1, self._dt)

    def residual(self) -> Array:
        """F of each, shape (drives,) [m]."""
        out = np.zeros(len(self._all))
        for n, drive in enumerate(self._all):
            if prescribes(drive.effect):
                assert drive.wanted is not None
                before, after = drive.wanted
                lag = before - self._q0[drive.key]  # ends of other steps, to rounding
                out[n] = -drive.size * (self._secant(drive)[1] - (after - before) - lag)
            else:
                out[n] = (drive.multiplier - self._law(drive)[0] / drive.size) / self.kappa[n]
        return out

    def compliance(self) -> Array:
        """dF/dλ of each [m/N]."""
        given = np.array([prescribes(drive.effect) for drive in self._all], dtype=bool)
        return np.where(given, 0.0, 1.0 / self.kappa)

    @property
    def effects(self) -> tuple[Element, ...]:
        """The effects."""
        return tuple(drive.effect for drive in self._all)

    def stiffness(self) -> Array:
        """Stiffness of each that is a law, at the last iterate, over ℓ², shape (drives,) [N/m]."""
        out = np.zeros(len(self._all))
        for n, drive in enumerate(self._all):
            if not isinstance(drive.effect, Motor):
                out[n] = -drive.effect.pull(self.ends(drive)[1])[1] / drive.size**2
        return out

    def _rows(self, rows: Sequence[Array], columns: int) -> csr_array:
        """A matrix of values of drives at their averages."""
        at = [(3 * drive.averages[:, None] + np.arange(3)).ravel() for drive in self._all]
        number = np.repeat(np.arange(len(at)), [own.size for own in at])
        every = np.concatenate([np.empty(0, int), *at])
        values = np.concatenate([np.empty(0), *(row.ravel() for row in rows)])
        return csr_array((values, (number, every)), shape=(len(at), columns))

    def _per_multiplier(self, drive: _Drive) -> Array:
        """Forces on its averages per λ, as a resistance, shape (3, 3)."""
        if self.static:
            end = self._start[drive.averages] + self._moved[drive.averages]
            return -drive.size * drive.coordinate.gradient(end)
        return -drive.size * self._secant(drive)[0]

    def _secant(self, drive: _Drive) -> tuple[Array, float]:
        """∇̄q of the step, shape (3, 3), and q₁ - q₀."""
        start, moved = self._start[drive.averages], self._moved[drive.averages]
        return secant(drive.coordinate, start, moved, drive.large)

    def add_to(self, forces: Array) -> Array:
        """Add their forces at the last iterate to those on averages, shape (averages, 3) [N]."""
        for drive in self._all:
            own = drive.multiplier * self._per_multiplier(drive)
            for k, force in zip(drive.averages, own, strict=True):
                forces[k] += force
        return forces

    def test(self, columns: int) -> csr_array:
        """Forces on averages per λ, as a resistance, shape (drives, columns)."""
        return self._rows([self._per_multiplier(drive) for drive in self._all], columns)

    def trial(self, columns: int) -> csr_array:
        """Derivatives of F by averages, shape (drives, columns)."""
        rows = []
        for drive, kappa in zip(self._all, self.kappa, strict=True):
            end = self._start[drive.averages] + self._moved[drive.averages]
            factor = -drive.size
            if not prescribes(drive.effect):
                factor = -self._law(drive)[1] / (drive.size * kappa)
            rows.append(factor * drive.coordinate.gradient(end))
        return self._rows(rows, columns)

    # After a step ---------------------------------------------------------------------------------

    def work(self) -> tuple[float, dict[str, float]]:
        """Work of motors in the step, and loss by dampers by their kind [J]."""
        done, taken = 0.0, dict[str, float]()
        for drive in self._all:
            q0, q1 = self.ends(drive)
            if isinstance(drive.effect, Motor):
                done += drive.multiplier * drive.size * (q1 - q0)
            elif not self.static and drive.effect.damping:
                kind = drive.effect.kind
                taken[kind] = taken.get(kind, 0.0) + drive.effect.taken(q0, q1, self._dt)
        return done, taken

    def stored(self, q: Mapping[tuple[int, str], float]) -> float:
        """Energy of springs and stops where coordinates are these [J]."""
        laws = ((d.effect, q[d.key]) for d in self._all if not isinstance(d.effect, Motor))
        return float(sum(law.stored(value) for law, value in laws))


def prescribes(effect: Element) -> bool:
    """Whether it is a motor that prescribes an angle or a travel."""
    return isinstance(effect, Motor) and effect.prescribes
