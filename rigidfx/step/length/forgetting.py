"""How fast errors of a motion are forgotten: at the rate at which damping takes its vibration.

An error is a motion itself, and is damped as that is. A vibration with the energy H, of which
damping takes the power D, decays with δ = D/2H, and so do errors of earlier steps:

    dE/dt = e - δ E ,    e the error that is made per time.

Without that, Σe of a structure that a load keeps moving grows for ever, while its error does not.
δ is the mean of the run so far, ∫ D dt / 2 ∫ H dt. It holds for what always comes back to where it
was: a structure of one part that supports hold against all rigid motions, from the start to the end
as all its damping acts, and that touches nothing. Free bodies keep an error of their place or their
turn.

Drag, α M v, takes up to twice as much from parts that a support moves as from a vibration, whose
energy is kinetic for half of the time. It damps all vibrations by α/2, and counts for no more.

That mean is one of the largest motion. Viscosity takes fast vibrations and leaves slow ones: where
an axial one dies out, bending rings on, and so do its errors. So there are several accounts, of
which
the largest counts: all errors, forgotten as above; and of each octave those that are slower than
ω_b, which are forgotten no faster than a vibration of that frequency is damped at least
(`rigidfx.step.length.damped`). Drag damps all alike, and needs the first only; there, and without
damping, octaves give the error of slow motion, as faster motion has a bound of its own
(`rigidfx.step.length.fast`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.effects import Contact, KelvinVoigt, MassDamping, NumericalDamping, StiffnessDamping
from rigidfx.scene.scene import Scene
from rigidfx.step.equations.eased_forces import EasedForces
from rigidfx.step.length.damped import Damped
from rigidfx.step.length.held import always, holding
from rigidfx.step.length.octaves import OF_CUT, Octaves

__all__ = ["Forgetting", "comes_back"]

Array = npt.NDArray[np.float64]

DAMPING = KelvinVoigt, MassDamping, NumericalDamping, StiffnessDamping
OTHERWISE = MassDamping.__name__, EasedForces.kind  # counted apart, and no damping


class Forgetting:
    """Finds rates from energies, and the parts of an error to which they belong.

    Attributes:
        by_frequency: Whether accounts forget at different rates.
        cuts: ω_b of all accounts but the first, that of all errors [1/s].
        rates: δ of each account [1/s].
        parts: Part of each account in the error of the last step; one for the first.
    """

    remembered: ClassVar[Remembered] = same("parts", "rates", "_taken", "_dragged", "_stayed") | {
        "_octaves": PART
    }

    def __init__(self, scene: Scene, points: int, time: float, step: float) -> None:
        """Nothing has moved. Collective.

        Args:
            scene: The problem.
            points: How many points are tracked.
            time: Length of the run [s].
            step: Shortest Δt [s].
        """
        self._comes_back = comes_back(scene)
        self._taken = self._dragged = self._stayed = 0.0
        self._damped = Damped(scene) if self._comes_back else None
        self.by_frequency = self._damped is not None and self._damped.by_frequency
        adds_up = not self.by_frequency and bool(scene.named(Contact))
        self._octaves = None if adds_up else Octaves(points, time, step)
        self.cuts = np.empty(0) if self._octaves is None else self._octaves.cuts
        accounts = 1 + self.cuts.size
        self.rates: Array = np.zeros(accounts)
        self.parts: Array = np.ones(accounts)

    def look(self, jerk: Array, swinging: Array, dt: float) -> None:
        """Find the parts of accounts in the error of a step that has been solved.

        Args:
            jerk: Of each point, shape (points, 3); the error per time goes with Δt² of it.
            swinging: Its root mean square over a turn, shape (points,).
            dt: Its length [s].
        """
        if self._octaves is not None:
            parts = self._octaves.look(dt**2 * jerk, dt**2 * swinging, dt)
            self.parts = np.concatenate([[1.0], parts])

    def accept(self) -> None:
        """Take note that the step that was looked at last is one."""
        if self._octaves is not None:
            self._octaves.accept(self.parts[1:])

    def follow(self, energy: float, dissipated: Mapping[str, float], dt: float) -> None:
        """Take note of a step.

        Args:
            energy: Kinetic and strain energy at its end [J].
            dissipated: Energy that each kind of damping took in it [J].
            dt: Its length [s].
        """
        if self._damped is None:
            return
        self._taken += sum(e for kind, e in dissipated.items() if kind not in OTHERWISE)
        self._dragged += dissipated.get(MassDamping.__name__, 0.0)
        self._stayed += energy * dt
        if self._stayed > 0:
            of_drag = min(self._dragged / (2 * self._stayed), self._damped.drag / 2)
            self.rates[:] = max(self._taken, 0.0) / (2 * self._stayed) + of_drag
        if self.by_frequency:
            least = self._damped.rates(OF_CUT * self.cuts, dt)
            self.rates[1:] = np.minimum(self.rates[1:], least)


def comes_back(scene: Scene) -> bool:
    """Whether a structure has but one place to come to rest in. Collective.

    Args:
        scene: The problem.
    """
    damping = [effect for kind in DAMPING for effect in scene.named(kind)]
    if scene.named(Contact) or not all(map(always, damping)):
        return False
    return bool(holding(scene))
