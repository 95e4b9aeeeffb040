"""Resonance of bodies that lack modes which Δt resolves, beside any equation of motion of these.

The static response to a force is right up to the lowest frequency ω that a body lacks. A lasting
force ρ⊥ above that may be in resonance with a mode that is not known. In the worst case all that is
withheld is in tune with it, and has gained by now the momenta s of one oscillator at each node,

    ṡ = ρ⊥ - Ω² p ,  ṗ = s ,    cos ΩΔt = Σ d₁·(d₀ + d₂) / (2 Σ d₁·d₁) ,

with Ω by three changes d of ρ⊥ from step to step, as of a sine, over the last steps. A blow leaves
little in it; a force that goes on at Ω adds up.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import ON_NODES, Remembered, same
from rigidfx.base.types import Array, Indices
from rigidfx.scene.scene import Scene
from rigidfx.switch.growth_control import GrowthControl

# ΩΔt that rounding may make of none.
LEAST = float(np.sqrt(np.finfo(np.float64).eps))


class Resonance:
    """Momenta that withheld forces may have built up in modes which bodies lack.

    Attributes:
        momenta: s at the owned nodes, shape (nodes, 3) [kg m/s].
    """

    remembered: ClassVar[Remembered] = same("_products") | dict.fromkeys(
        ("momenta", "_impulse", "_last", "_change", "_before"), ON_NODES
    )

    def __init__(self, scene: Scene, control: GrowthControl) -> None:
        """Nothing has built up.

        Args:
            scene: The problem.
            control: Over how many steps the frequency of forces is a mean, and in how many periods
                oscillators fall to 1/e.
        """
        self._scene, self._control = scene, control
        self.momenta, self._impulse, self._last, self._change, self._before = np.zeros(
            (5, scene.owned_nodes, 3)
        )
        # Sums of products of changes, and number of steps, by body:
        self._products: dict[int, tuple[float, float, int]] = {}

    def keep(self, nodes: Mapping[int, Indices]) -> None:
        """Forget all but some bodies.

        Args:
            nodes: Owned nodes of these, by number.
        """
        self._products = {k: of for k, of in self._products.items() if k in nodes}
        others = np.ones(len(self.momenta), dtype=bool)
        for number in self._products:
            others[nodes[number]] = False
        for field in (self.momenta, self._impulse):
            field[others] = 0.0

    def advance(
        self, force: Array, nodes: Mapping[int, Indices], lacking: Mapping[int, float], dt: float
    ) -> None:
        """Advance by a step. Collective.

        Args:
            force: ρ⊥ at the owned nodes, shape (nodes, 3) [N].
            nodes: Owned nodes of the bodies, by number.
            lacking: The lowest ω that each lacks, by number [1/s].
            dt: Δt [s].
        """
        change = force - self._last
        m = self._scene.averaging_mass[: len(force), None]
        light = np.divide(self._change, m, out=np.zeros_like(force), where=m > 0)
        both = np.stack([2 * self._change * light, (change + self._before) * light])
        self._last, self._change, self._before = force.copy(), change, self._change
        local = [both[:, at].sum(axis=(1, 2)) for at in nodes.values()]
        sums = self._scene.sum(np.reshape(local, (-1, 2)))
        for (number, at), new in zip(nodes.items(), sums, strict=True):
            *before, steps = self._products.get(number, (0.0, 0.0, 0))
            square, product = np.array(before) * (1 - 1 / self._control.every) + new * (steps > 2)
            self._products[number] = float(square), float(product), steps + 1
            if not square > 0:
                continue
            angle = float(np.arccos(np.clip(product / square, -1.0, 1.0)))  # Ω Δt
            angle = max(angle, LEAST)
            p, s = self._impulse[at], self.momenta[at]
            middle = force[at] * (dt / angle) ** 2 * (angle > lacking[number] * dt)
            c, sine = np.cos(angle), np.sin(angle)
            left = np.exp(-angle / 2 / np.pi / self._control.periods)
            self._impulse[at] = left * (middle + c * (p - middle) + sine * dt / angle * s)
            self.momenta[at] = left * (c * s - sine * angle / dt * (p - middle))
