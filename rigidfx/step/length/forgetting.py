"""How fast errors of a motion are forgotten: at the rate at which damping takes its vibration.

An error is a motion itself, and is damped as that is. A vibration with the energy H, of which
damping takes the power D, decays with δ = D/2H, and so does what steps have erred by before:

    dE/dt = e - δ E ,    e the error that is made per time.

Without that, Σe of a structure that a load keeps moving grows for ever, while its error does not.
δ is the mean of the run so far, ∫ D dt / 2 ∫ H dt. It holds for what always comes back to where it
was: a structure of one part that supports hold against all rigid motions, from the start to the
end as all its damping acts, and that touches nothing. What flies freely keeps an error of its place
or its turn.
"""

from __future__ import annotations

from rigidfx.effects import Contact, KelvinVoigt, MassDamping, NumericalDamping, StiffnessDamping
from rigidfx.scene.scene import Scene
from rigidfx.step.length.held import always, holding

__all__ = ["Forgetting", "comes_back"]

DAMPING = KelvinVoigt, MassDamping, NumericalDamping, StiffnessDamping


class Forgetting:
    """Finds the rate from energies.

    Attributes:
        rate: δ [1/s].
    """

    def __init__(self, scene: Scene) -> None:
        """Nothing has moved. Collective.

        Args:
            scene: The problem.
        """
        self._comes_back = comes_back(scene)
        self._taken = self._stayed = self.rate = 0.0

    def follow(self, energy: float, taken: float, dt: float) -> None:
        """Take note of a step.

        Args:
            energy: Kinetic and strain energy at its end [J].
            taken: What damping took in it [J].
            dt: Its length [s].
        """
        if not self._comes_back:
            return
        self._taken, self._stayed = self._taken + taken, self._stayed + energy * dt
        if self._stayed > 0:
            self.rate = max(self._taken, 0.0) / (2 * self._stayed)


def comes_back(scene: Scene) -> bool:
    """Whether a structure has but one place to come to rest in. Collective.

    Args:
        scene: The problem.
    """
    damping = [effect for kind in DAMPING for effect in scene.named(kind)]
    if scene.named(Contact) or not all(map(always, damping)):
        return False
    return bool(holding(scene))
