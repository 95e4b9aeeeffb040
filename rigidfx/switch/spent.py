"""How far reduced parts are from the expansion that their shapes have: ν, as a run goes on."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.mechanics.rigid_body import Body, RigidBody
from rigidfx.scene.scene import Scene
from rigidfx.shapes.excess import Excess
from rigidfx.shapes.part import LACKING, Part
from rigidfx.shapes.responses import Responses
from rigidfx.state import State
from rigidfx.switch.spun_joints import SpinLimits, off_by


class Spent:
    """ν of the parts of a run that are named `Reduced`.

    Attributes:
        looked: Strain energy of each part when ν was looked at [J], and ν, by its name.
    """

    remembered: ClassVar[Remembered] = same("looked", "_large")

    def __init__(self, scene: Scene) -> None:
        """Nothing has been looked at."""
        self._scene, self._limits = scene, SpinLimits(scene)
        self.looked: dict[str, tuple[float, float]] = {}
        self._large: frozenset[str] = frozenset()  # parts of whose ν has been warned

    def follow(
        self, state: State, part_of: Callable[[Body], tuple[Responses, Part]]
    ) -> dict[str, float]:
        """ν of each part, looked at where its strain energy is ten times that of the last look.

        As ν grows with that, it is not too large in between. Where it comes near, twice is enough.
        Motions that rounding makes have none, and parts with less than `LACKING`² of the largest
        strain energy do not count. Collective.

        Raises:
            SceneError: On every rank, if a part spins too fast between joints.
        """
        shapes = state.bodies.of.shapes
        if shapes is None:
            return {}
        self._limits.check(state)
        q, least = state.bodies.q, np.sqrt(np.finfo(np.float64).eps)
        some, energies = q[shapes.some], np.zeros(len(q))
        energies[shapes.some] = 0.5 * np.einsum("bk,bkl,bl->b", some, shapes.stiffness, some)
        most = max([energies.max(), *(energy for energy, _ in self.looked.values())])
        for body, own, energy in zip(state.bodies, q, energies, strict=True):
            before, nu = self.looked.get(body.data.name, (0.0, 0.0))
            grown = 2 if 10 * off_by(nu) > LACKING else 10
            moves = body.data.named and np.abs(own).max() > least * body.data.length
            if moves and energy > max(grown * before, LACKING**2 * most):
                self._look(state.t, body, *part_of(body))
        return {name: nu for name, (_, nu) in self.looked.items()}

    def _look(self, t: float, body: Body, responses: Responses, part: Part) -> None:
        """Find ν of a part; warn once where it is not small. Collective."""
        name = body.data.name
        d = np.einsum("nka,k->na", whole_modes(body.data), body.motion.q)
        found = Excess(responses, part, d)
        self.looked[name] = found.energy, found.nu
        if off_by(found.nu) <= LACKING or name in self._large:
            return
        self._large |= {name}
        count, lower, upper = found.spent()
        least = np.sqrt(np.finfo(np.float64).eps) * np.abs(upper - lower).max()
        ends = [np.where(np.abs(end) < least, 0.0, end) for end in (lower, upper)]
        box = " to ".join("(" + ", ".join(f"{x:.4g}" for x in end) + ")" for end in ends)
        warn(
            self._scene.comm,
            f"Reduced '{name}': at t = {t:.4g} s it deforms too far for its shapes. The "
            f"energy of its cells differs by ν = {found.nu:.2%} of the strain energy: amplitudes "
            f"err by some {off_by(found.nu):.1%}, frequencies by a quarter of that. Most of it is "
            f"in {count} cells, those within {box} m. Keep these flexible: take them out of the "
            "set of the Reduced.",
        )


def whole_modes(data: RigidBody) -> Array:
    """Shapes at the nodes of a body, with the drift of those that are held, shape (nodes, m, 3)."""
    return np.zeros((data.nodes.size, 0, 3)) if data.shapes is None else data.shapes.whole
