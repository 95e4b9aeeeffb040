"""Resonance of bodies that lack modes which Δt resolves, beside any equation of motion of these.

The static response to a force is right up to the lowest frequency ω that a body lacks. A lasting
force ρ⊥ above that may be in resonance with a mode that is not known. In the worst case all that is
withheld is in tune with it, and has gained by now the momenta s of one oscillator at each node,

    ṡ = ρ⊥ - Ω² p ,  ṗ = s ,    cos ΩΔt = Σ d₁·(d₀ + d₂) / (2 Σ d₁·d₁) ,

with Ω by three changes d of ρ⊥ from step to step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.remembered import Each, Record, Remembered
from rigidfx.base.types import Array
from rigidfx.scene.scene import Scene
from rigidfx.withheld.fields import Fields, Force, dots

# ΩΔt that rounding may make of none.
LEAST = float(np.sqrt(np.finfo(np.float64).eps))


@dataclass(frozen=True)
class Tuned:
    """What a body may have built up, and what tells the frequency of its forces.

    Attributes:
        origin: The body's; if it loses cells it is another one.
        momenta: s [kg m/s].
        impulse: p [kg m].
        last: ρ⊥ of the last step [N].
        change: Its change in that step.
        before: That in the step before.
        square, product: Sums of products of changes.
        steps: How many there were.
    """

    origin: Array
    momenta: Force
    impulse: Force
    last: Force
    change: Force
    before: Force
    square: float
    product: float
    steps: int

    @classmethod
    def begun(cls, origin: Array, none: Force) -> Tuned:
        """Nothing has built up."""
        return cls(origin, none, none, none, none, none, 0.0, 0.0, 0)

    def followed(self, fields: Fields) -> Tuned:
        """The same with the fields that the body has now. Collective."""
        names = ("momenta", "impulse", "last", "change", "before")
        forces: dict[str, Any] = {name: fields.followed(getattr(self, name)) for name in names}
        return replace(self, **forces)


_FORCE = Record(Force, "beside")


class Resonance:
    """Momenta that withheld forces may have built up in modes which bodies lack."""

    remembered: ClassVar[Remembered] = {
        "_of": Each(
            Tuned, momenta=_FORCE, impulse=_FORCE, last=_FORCE, change=_FORCE, before=_FORCE
        )
    }

    def __init__(self, scene: Scene, every: int, periods: float) -> None:
        """Nothing has built up.

        The frequency of forces is a mean over `every` so many steps, and oscillators fall to 1/e in
        so many periods.
        """
        self._scene, self._every, self._periods = scene, every, periods
        self._of: dict[int, Tuned] = {}  # by number

    def momenta(self, fields: Fields) -> Force | None:
        """s of a body; None before its first step. Collective."""
        known = self._known(fields)
        return None if known is None else fields.followed(known.momenta)

    def _known(self, fields: Fields) -> Tuned | None:
        known = self._of.get(fields.data.number)
        same = known is not None and np.array_equal(known.origin, fields.data.origin)
        return known if same else None

    def advance(
        self, forces: Sequence[tuple[Fields, Force]], lacking: Mapping[int, float], dt: float
    ) -> None:
        """Advance by Δt with ρ⊥ of bodies and the lowest ω that each lacks [1/s]; forget others.

        Collective.
        """
        known, pairs, out = [], [], {}
        for fields, force in forces:
            before = self._known(fields) or Tuned.begun(fields.data.origin, 0.0 * force)
            own = before.followed(fields)
            change = force - own.last
            known.append((fields.data.number, force, own, change))
            pairs += [(fields, 2.0 * own.change, own.change)]
            pairs += [(fields, change + own.before, own.change)]
        products = dots(self._scene, pairs).reshape(-1, 2)
        for (number, force, own, change), new in zip(known, products, strict=True):
            sums = np.array([own.square, own.product]) * (1 - 1 / self._every)
            square, product = sums + new * (own.steps > 2)
            out[number] = replace(
                self._built_up(own, force, square, product, lacking[number], dt),
                last=force,
                change=change,
                before=own.change,
                square=float(square),
                product=float(product),
                steps=own.steps + 1,
            )
        self._of = out

    def _built_up(
        self, own: Tuned, force: Force, square: float, product: float, lacking: float, dt: float
    ) -> Tuned:
        """Momenta of a body after a step with its force."""
        if not square > 0:
            return own
        angle = float(np.arccos(np.clip(product / square, -1.0, 1.0)))  # Ω Δt
        angle = max(angle, LEAST)
        p, s = own.impulse, own.momenta
        middle = (dt / angle) ** 2 * (angle > lacking * dt) * force
        c, sine = np.cos(angle), np.sin(angle)
        left = np.exp(-angle / 2 / np.pi / self._periods)
        return replace(
            own,
            impulse=left * (middle + c * (p - middle) + sine * dt / angle * s),
            momenta=left * (c * s - sine * angle / dt * (p - middle)),
        )
