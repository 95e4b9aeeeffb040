"""Resonance of bodies that lack modes which Δt resolves: docs/theory/waking.md, rule 4.

In the worst case all that is withheld is in tune with a mode that is not known, and has gained by
now the momenta s of one oscillator at each node,

    ṡ = -Ω w ,  ẇ = Ω s - ρ̇⊥/Ω ,    cos ΩΔt = Σ d₁·(d₀ + d₂) / (2 Σ d₁·d₁) ,

with w how far it is off its balance, times its mass and Ω, and with Ω by three changes d of ρ⊥ from
step to step, in steps of one length.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isclose
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
    """What a body may have built up, and what tells the frequency of its forces."""

    origin: Array  # the body's; if it loses cells it is another one
    momenta: Force  # s [kg m/s]
    off: Force  # w [kg m/s]
    last: Force  # ρ⊥ of the last step [N]
    change: Force  # its change in that step
    before: Force  # that in the step before
    square: float  # sums of products of changes
    product: float  # likewise
    steps: int  # how many there were in steps of one length ...
    dt: float  # ... which this is [s]
    frequency: float  # Ω, 0 while unknown [1/s]

    @classmethod
    def begun(cls, origin: Array, none: Force) -> Tuned:
        """Nothing has built up."""
        return cls(origin, none, none, none, none, none, 0.0, 0.0, 0, 0.0, 0.0)

    def followed(self, fields: Fields) -> Tuned:
        """The same with the fields that the body has now. Collective."""
        names = ("momenta", "off", "last", "change", "before")
        forces: dict[str, Any] = {name: fields.followed(getattr(self, name)) for name in names}
        return replace(self, **forces)


_FORCE = Record(Force, "beside")


class Resonance:
    """Momenta that withheld forces may have built up in modes which bodies lack."""

    remembered: ClassVar[Remembered] = {
        "_of": Each(Tuned, momenta=_FORCE, off=_FORCE, last=_FORCE, change=_FORCE, before=_FORCE)
    }

    def __init__(self, scene: Scene, every: int, periods: float) -> None:
        """Nothing has built up.

        The frequency of forces is a mean over `every` so many steps, and oscillators fall to 1/e in
        so many periods.
        """
        self._scene, self._every, self._periods = scene, every, periods
        self._of: dict[int, Tuned] = {}  # by number

    def lasting(self, fields: Fields) -> tuple[float, Force] | None:
        """Ω [1/s], and the forces 2 Ω s on a body; None while Ω is not known. Collective."""
        known = self._known(fields)
        if known is None or not known.frequency > 0:
            return None
        return known.frequency, 2 * known.frequency * fields.followed(known.momenta)

    def _known(self, fields: Fields) -> Tuned | None:
        known = self._of.get(fields.data.number)
        same = known is not None and np.array_equal(known.origin, fields.data.origin)
        return known if same else None

    def advance(
        self, forces: Sequence[tuple[Fields, Force]], lacking: Mapping[int, float], dt: float
    ) -> None:
        """Advance by Δt with ρ⊥ of bodies and the lowest ω that each lacks [1/s]. Collective."""
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
            even = isclose(dt, own.dt)
            kept = np.array([own.square, own.product]) * (1 - 1 / self._every) * even
            square, product = kept + new * (even and own.steps > 2)
            omega = own.frequency
            if square > 0:
                angle = float(np.arccos(np.clip(product / square, -1.0, 1.0)))
                omega = max(angle, LEAST) / dt
            momenta, off = self._built_up(own, float(omega > lacking[number]) * change, omega, dt)
            out[number] = Tuned(
                own.origin,
                momenta,
                off,
                last=force,
                change=change,
                before=own.change,
                square=float(square),
                product=float(product),
                steps=1 + own.steps * int(even),
                dt=dt,
                frequency=omega,
            )
        self._of = out

    def _built_up(self, own: Tuned, change: Force, omega: float, dt: float) -> tuple[Force, Force]:
        """s and w of a body after a step in which its force has changed at its start."""
        if not omega > 0:
            return own.momenta, own.off
        s, w = own.momenta, own.off - (1 / omega) * change
        c, sine = np.cos(omega * dt), np.sin(omega * dt)
        left = np.exp(-omega * dt / 2 / np.pi / self._periods)
        return left * (c * s - sine * w), left * (c * w + sine * s)
