"""Motors and springs of joints, bound: a multiplier and an equation each beside the joints' rows.

A multiplier λ is the force along a coordinate q, over the joint's size ℓ where q is an angle. Its
equation is F = 0 [m],

    prescribed      ℓ (q₁ - q(t₁)) = 0
    a given force   (λ - f(t½)/ℓ)/κ = 0
    a spring        (λ + (k (½ (q₀ + q₁) - q_r) + c (q₁ - q₀)/Δt)/ℓ)/κ = 0

with κ = 2 m/Δt² of the mass that the joint moves. So stiff springs are no stiffness of nodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from rigidfx.effects.joints.coordinates import Coordinate, secant
from rigidfx.effects.joints.elements import JointSpring, Motor, coordinate_of
from rigidfx.effects.joints.joint import Joint

__all__ = ["Drives"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass
class _Drive:
    """One of them.

    Attributes:
        effect: The effect.
        key: Number of the joint, and name of the coordinate.
        coordinate: The coordinate.
        averages: Numbers of its averages among those of all joints.
        size: ℓ, 1 of a travel [m].
        large: What of the coordinate counts as large, in its unit.
        mass: Mass that the joint moves, in order of magnitude [kg].
        wanted: q that is prescribed, at the start and at the end of the step.
        force: Force or torque that is given.
        multiplier: λ of the last iterate [N].
    """

    effect: Motor | JointSpring
    key: tuple[int, str]
    coordinate: Coordinate
    averages: Ints
    size: float
    large: float
    mass: float
    wanted: tuple[float, float] | None = None
    force: float = 0.0
    multiplier: float = 0.0


class Drives:
    """The motors that act and the springs, on the averages of all joints."""

    def __init__(
        self, scene: Any, elements: Sequence[Motor | JointSpring], firsts: Sequence[int]
    ) -> None:
        """Find their joints.

        Args:
            scene: The problem.
            elements: Those that act.
            firsts: Number of each joint's first average.
        """
        joints = scene.named(Joint)
        self._all: list[_Drive] = []
        for effect in elements:
            along = effect.coordinate if isinstance(effect, Motor) else effect.along
            joint, name = coordinate_of(scene, effect.owner, effect.joint, along)
            k, pieces = joints.index(joint), joint.pieces
            of = pieces.coordinates[name]
            numbers = firsts[k] + np.array(of.averages)
            size, large = (pieces.size, 1.0) if name == "angle" else (1.0, pieces.size)
            self._all.append(_Drive(effect, (k, name), of, numbers, size, large, pieces.mass))
        self._dt = 1.0
        self._q0: Mapping[tuple[int, str], float] = {}
        none: Array = np.zeros((0, 3))
        self._start = self._moved = none

    def __len__(self) -> int:
        """How many there are."""
        return len(self._all)

    @property
    def masses(self) -> Array:
        """Mass that each one's joint moves [kg]."""
        return np.array([drive.mass for drive in self._all], dtype=np.float64)

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
        return [d.effect.owner for d in self._all if _prescribes(d.effect)]

    def remember(self, notes: dict[int, Any]) -> None:
        """Take over what earlier divisions knew."""
        for drive in self._all:
            known = notes.get(id(drive.effect))
            if known is not None:
                drive.multiplier, wanted = known
                drive.wanted = None if wanted is None else (wanted, wanted)

    def note(self, notes: dict[int, Any]) -> None:
        """Leave what later divisions want to know: λ, and q that is prescribed at the end."""
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
                drive.force = motor.at(t + 0.5 * dt)

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
        """Torque [N m] or force [N] of each, by number of its joint and its owner."""
        out: dict[int, dict[str, float]] = {}
        for drive in self._all:
            out.setdefault(drive.key[0], {})[drive.effect.owner] = drive.multiplier * drive.size
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
        k, c = effect.stiffness, effect.damping / self._dt
        return -k * (0.5 * (q0 + q1) - effect.rest) - c * (q1 - q0), -0.5 * k - c

    def residual(self) -> Array:
        """F of each, shape (drives,) [m]."""
        out = np.zeros(len(self._all))
        for n, drive in enumerate(self._all):
            if _prescribes(drive.effect):
                assert drive.wanted is not None
                out[n] = -drive.size * (self.ends(drive)[1] - drive.wanted[1])
            else:
                out[n] = (drive.multiplier - self._law(drive)[0] / drive.size) / self._kappa(drive)
        return out

    def _kappa(self, drive: _Drive) -> float:
        return 2.0 * drive.mass / self._dt**2

    def compliance(self) -> Array:
        """dF/dλ of each [m/N]."""
        own = (0.0 if _prescribes(d.effect) else 1.0 / self._kappa(d) for d in self._all)
        return np.fromiter(own, dtype=np.float64)

    def _rows(self, rows: Sequence[Array], columns: int) -> csr_array:
        """A matrix of what drives have at their averages."""
        at = [(3 * drive.averages[:, None] + np.arange(3)).ravel() for drive in self._all]
        number = np.repeat(np.arange(len(at)), [own.size for own in at])
        every = np.concatenate([np.empty(0, int), *at])
        values = np.concatenate([np.empty(0), *(row.ravel() for row in rows)])
        return csr_array((values, (number, every)), shape=(len(at), columns))

    def test(self, columns: int) -> csr_array:
        """Forces on averages per λ, as a resistance, shape (drives, columns)."""
        rows = []
        for drive in self._all:
            start, moved = self._start[drive.averages], self._moved[drive.averages]
            q0, q1 = self.ends(drive)
            rows.append(-drive.size * secant(drive.coordinate, start, moved, q1 - q0, drive.large))
        return self._rows(rows, columns)

    def trial(self, columns: int) -> csr_array:
        """Derivatives of F by averages, shape (drives, columns)."""
        rows = []
        for drive in self._all:
            end = self._start[drive.averages] + self._moved[drive.averages]
            factor = -drive.size
            if not _prescribes(drive.effect):
                factor = -self._law(drive)[1] / (drive.size * self._kappa(drive))
            rows.append(factor * drive.coordinate.gradient(end))
        return self._rows(rows, columns)

    # After a step ---------------------------------------------------------------------------------

    def work(self) -> tuple[float, float]:
        """Work of motors in the step, and what dampers have taken [J]."""
        done = taken = 0.0
        for drive in self._all:
            q0, q1 = self.ends(drive)
            if isinstance(drive.effect, Motor):
                done += drive.multiplier * drive.size * (q1 - q0)
            else:
                taken += drive.effect.damping * (q1 - q0) ** 2 / self._dt
        return done, taken

    def stored(self, q: Mapping[tuple[int, str], float]) -> float:
        """Energy of the springs where coordinates are these [J]."""
        springs = ((d.effect, q[d.key]) for d in self._all if isinstance(d.effect, JointSpring))
        return sum(0.5 * s.stiffness * (value - s.rest) ** 2 for s, value in springs)


def _prescribes(effect: Motor | JointSpring) -> bool:
    return isinstance(effect, Motor) and effect.prescribes
