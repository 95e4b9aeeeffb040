"""How far shapes hold, as a run goes on: as bodies bend, and as they spin between joints.

ν is how far a body is from the expansion that its shapes have. It grows with the energy of these,
½ q·Ωq, and with q·Dq, the square of their displacement by mass: the energy of a bar that is
stretched hardly changes as it begins to bend. It is looked at again once one of them has doubled,
or grown eightfold, for named parts far below the bound. q·Dq counts for these, and where
displacements are bounded. Above the bound cells of bodies that were found wake; for named parts the
run warns.

A part that spins on a hinge is stretched by the hinge's force, and so is stiffer. Shapes do not
know that. A beam that a motor spins up then lags by 4.7 (W/ω)² too much, with W its spin and ω its
lowest frequency while nothing holds it (`test_reduced_joints.py`). So W² is ω²/300 at most: parts
that are named are refused above, and found ones wake. The shapes of a part that was frozen while it
span know the stresses of that spin.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
from scipy.linalg import eigvalsh

from rigidfx.base.errors import SceneError
from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.base.types import Array, Indices
from rigidfx.base.warning import warn
from rigidfx.coupling.dof_layout import AtNodes
from rigidfx.effects import Joint
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, RigidBody
from rigidfx.mechanics.shapes import Shapes
from rigidfx.scene.scene import Scene
from rigidfx.shapes.excess import About, Excess
from rigidfx.shapes.part import LACKING
from rigidfx.state import State

BOUND = 0.003  # of ν, above which cells wake, and a run warns: amplitudes err by 0.9 %
# The same of bodies that no support holds, where displacements are bounded by 3 ν of the bend: as
# far as that has been compared. Strips that supports stretch erred by 1.8 % where 1 % was asked.
FARTHEST = 0.03
DRIFT = 3.5  # see below
# Factors of ½ q·Ωq or q·Dq after which ν is looked at again: near its bound, and far below it.
NEAR = 2.0
FAR = NEAR * NEAR * NEAR
SHARE = 0.3  # part of the largest miss of any node, by mass, above which cells wake
LEAST = 1e-6  # part of the largest ½ q·Ωq so far up to which ν is not looked at
ROUNDING = float(np.sqrt(np.finfo(np.float64).eps))  # of q, over the length of a body


def off_by(ratio: float) -> float:
    """Bound of the relative error of amplitudes, by the share of energy that shapes lack: ν.

    With ν forces err by 2 ν where the energy has a fourth order. With spin, see above, the share is
    the square of it over that of the lowest frequency.
    """
    return 3 * ratio


class Drift:
    """How far bodies that bend have drifted off, as their frequencies err: by `DRIFT` ∫ ν |ḋ| dt.

    The frequency of a vibration of amplitude A errs by ¾ ν, with ν at A: it is off by 4.7 ν A more
    in each period. ν goes with q·Dq, so that the integral is 4/3 ν A a period. In tension ν stays
    as A falls, and the drift is larger than this.
    """

    remembered: ClassVar[Remembered] = same("_of")

    def __init__(self) -> None:
        """Nothing has bent."""
        # Of each body, by number: 3½ ν |d| over (q·Dq)^1½, and its drift [m].
        self._of: dict[int, tuple[float, float]] = {}

    def of(self, number: int) -> float:
        """The drift of a body [m]."""
        return self._of.get(number, (0.0, 0.0))[1]

    def looked(self, body: Body, nu: float, size: float) -> None:
        """ν of a body was found, where it has moved so far [m]."""
        assert body.data.shapes is not None
        _, square = _sizes(body.data.shapes, body.motion.q)
        self._of[body.data.number] = (
            DRIFT * nu * size / (square * float(np.sqrt(square))),
            self.of(body.data.number),
        )

    def advance(self, bodies: Bodies, dt: float) -> float:
        """Follow bodies in a step that ended so; the largest drift [m]."""
        for body in bodies:
            number, shapes = body.data.number, body.data.shapes
            if number in self._of and shapes is not None:
                slope, drift = self._of[number]
                (_, square), (_, rate) = (
                    _sizes(shapes, x) for x in (body.motion.q, body.motion.q_rate)
                )
                self._of[number] = slope, drift + slope * square * float(np.sqrt(rate)) * dt
        return max((drift for _, drift in self._of.values()), default=0.0)

    def forget(self, number: int) -> None:
        """Forget a body that is no more."""
        self._of.pop(number, None)


class SpinLimits:
    """Says which parts between joints spin too fast for their shapes."""

    def __init__(self, scene: Scene) -> None:
        """Nothing is computed."""
        self._scene, self._joints = scene, scene.named(Joint)
        self._lowest: dict[tuple[int, int], float] = {}
        self._slow = float(np.sqrt(LACKING / off_by(1.0)))  # spin over the lowest frequency

    def limit(self, body: Body, known: Array) -> float | None:
        """Spin that a body has passed; None if it has not [rad/s]. Collective.

        Stresses by spins W are linear in WWᵀ, and shapes know those of a spin that stays, in its
        frame.
        """
        own, W = body.data.shapes, body.motion.angular_velocity_body
        if not self._joints or own is None or own.drift is not None:
            return None
        key = body.data.number, len(own)
        if key not in self._lowest:
            self._lowest[key] = self._found(body)
        changed, limit = np.outer(W, W) - np.outer(known, known), self._slow * self._lowest[key]
        return limit if np.linalg.norm(changed, 2) > limit**2 else None

    def forget(self, number: int) -> None:
        """Forget a body that is no more."""
        self._lowest = {key: own for key, own in self._lowest.items() if key[0] != number}

    def check(self, state: State) -> None:
        """Refuse parts named `Reduced` whose joints would stiffen them. Collective.

        Raises:
            SceneError: On every rank, with the limit.
        """
        for body in state.bodies if self._joints else ():
            limit = self.limit(body, np.zeros(3)) if body.data.named else None
            if limit is not None:
                spin = float(np.linalg.norm(body.motion.angular_velocity))
                raise SceneError(
                    f"Reduced '{body.data.name}': at t = {state.t:.4g} s it spins at {spin:.4g} "
                    f"rad/s between joints, whose forces stiffen it. Its shapes hold up to "
                    f"{limit:.4g} rad/s, {self._slow:.1%} of its lowest frequency of "
                    f"{limit / self._slow / (2 * np.pi):.4g} Hz. Take the Reduced away: keep its "
                    "cells flexible, or name it Rigid."
                )

    def _found(self, body: Body) -> float:
        """Lowest frequency of a part that no joint holds; ∞ of others. Collective [rad/s]."""
        shapes, own = body.data.shapes, body.data.nodes
        assert shapes is not None
        faces = [a.nodes for joint in self._joints for a in joint.averages]
        if not self._scene.sum(sum(np.isin(nodes, own).sum() for nodes in faces)):
            return np.inf
        return float(np.sqrt(max(eigvalsh(shapes.stiffness, shapes.mass)[0], 0.0)))


class Looks:
    """Says when ν of a body is to be looked at."""

    remembered: ClassVar[Remembered] = same("_next", "_largest")

    def __init__(self) -> None:
        """Nothing has been looked at."""
        # ½ q·Ωq and q·Dq of each body, by number, above which ν is looked at again [J, kg m²].
        self._next: dict[int, tuple[float, float]] = {}
        self._largest = 0.0  # strain energy of any body so far [J]

    def due(self, body: Body, moves: bool = True) -> bool:
        """Whether ν of a body is to be looked at now, also as it `moves` more without energy."""
        data, shapes, q = body.data, body.data.shapes, body.motion.q
        if shapes is None:
            return False
        energy, square = _sizes(shapes, q)
        self._largest = max(self._largest, energy, data.frozen.strain)
        if np.abs(q).max() <= ROUNDING * data.length or energy <= LEAST * self._largest:
            return False
        known = self._next.get(data.number, (0.0, 0.0))
        return energy > known[0] or (moves and square > known[1])

    def looked(self, body: Body, grown: float) -> None:
        """ν of a body was looked at; it is again once its energy or way has grown by a factor."""
        assert body.data.shapes is not None
        energy, square = _sizes(body.data.shapes, body.motion.q)
        self._next[body.data.number] = grown * energy, grown * square

    def forget(self, number: int) -> None:
        """Forget a body that is no more."""
        self._next.pop(number, None)


def _sizes(shapes: Shapes, q: Array) -> tuple[float, float]:
    """½ q·Ωq and q·Dq [J, kg m²]."""
    return 0.5 * float(q @ shapes.stiffness @ q), float(q @ shapes.mass @ q)


class Spent:
    """ν of the parts of a run that are named `Reduced`.

    Attributes:
        nu: ν of each part, the largest so far, by its name.
    """

    remembered: ClassVar[Remembered] = same("nu", "_rise", "_large") | {"_looks": PART}

    def __init__(self, scene: Scene) -> None:
        """Nothing has been looked at."""
        self._scene, self._limits, self._looks = scene, SpinLimits(scene), Looks()
        self.nu: dict[str, float] = {}
        self._rise: dict[str, float] = {}  # ν over q·Dq when it was looked at [1/(kg m²)]
        self._large: frozenset[str] = frozenset()  # parts of whose ν has been warned

    def follow(self, state: State, about: Callable[[Body], About]) -> dict[str, float]:
        """ν of each part; `about` expands one. Collective.

        Raises:
            SceneError: On every rank, if a part spins too fast between joints.
        """
        if state.bodies.of.shapes is None:
            return {}
        self._limits.check(state)
        for body in state.bodies:
            if body.data.named and body.data.shapes is not None:
                name, (_, square) = body.data.name, _sizes(body.data.shapes, body.motion.q)
                if self._looks.due(body):
                    found = Excess(about(body), body)
                    self._look(state.t, body, found)
                    self._rise[name] = found.nu / square
                self.nu[name] = max(self.nu.get(name, 0.0), self._rise.get(name, 0.0) * square)
        return dict(self.nu)

    def _look(self, t: float, body: Body, found: Excess) -> None:
        """Warn once where ν of a part is not small. Collective."""
        name = body.data.name
        self._looks.looked(body, FAR if FAR * found.nu <= BOUND else NEAR)
        if found.nu <= BOUND or name in self._large:
            return
        self._large |= {name}
        count, lower, upper = found.spent()
        least = ROUNDING * np.abs(upper - lower).max()
        ends = [np.where(np.abs(end) < least, 0.0, end) for end in (lower, upper)]
        box = " to ".join("(" + ", ".join(f"{x:.4g}" for x in end) + ")" for end in ends)
        warn(
            self._scene.comm,
            f"Reduced '{name}': at t = {t:.4g} s it deforms too far for its shapes. The "
            f"energy or the forces of its cells differ by ν = {found.nu:.2%}: amplitudes "
            f"err by some {off_by(found.nu):.1%}, frequencies by a quarter of that. Most of it is "
            f"in {count} cells, those within {box} m. Keep these flexible: take them out of the "
            "set of the Reduced.",
        )


def most_bent(scene: Scene, data: RigidBody, found: Excess) -> Indices:
    """Owned cells of a body that have most of its ν. Collective."""
    marks: Array = np.zeros(scene.owned_nodes)
    marks[data.nodes] = found.most(SHARE)
    return np.asarray(data.cells[at_cells(scene, marks, data.cells) > 0])


def at_cells(scene: Scene, values: Array, cells: Indices) -> Array:
    """The largest of values at owned nodes in each of some owned cells. Collective."""
    at = AtNodes(scene).of_owners(values)[scene.space.dofmap.list[cells]]
    return np.asarray(at.max(axis=1, initial=0.0))
