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

from math import inf

import numpy as np

from rigidfx.effects import (
    Contact,
    KelvinVoigt,
    MassDamping,
    NumericalDamping,
    StiffnessDamping,
    Windowed,
)
from rigidfx.scene.scene import Scene

__all__ = ["Forgetting", "comes_back"]

DAMPING = KelvinVoigt, MassDamping, NumericalDamping, StiffnessDamping
SPREAD = 1e-6  # of nodes that are held, the second axis over the first, squared: they form no line


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
    if scene.parts.count > 1 or scene.named(Contact) or not all(map(_always, damping)):
        return False
    X, n = scene.space.tabulate_dof_coordinates(), scene.owned_nodes
    for support, nodes in scene.supports:
        if len(support.axes) < 3 or not _always(support):
            continue
        x = X[nodes[nodes < n]]
        ones = np.hstack([np.ones((len(x), 1)), x])
        moments = np.asarray(scene.sum(ones.T @ ones))
        centre = moments[0, 1:] / moments[0, 0]
        spread = np.linalg.eigvalsh(moments[1:, 1:] / moments[0, 0] - np.outer(centre, centre))
        if spread[1] > SPREAD * spread[2]:
            return True
    return False


def _always(effect: Windowed) -> bool:
    """Whether an effect acts from the start to the end."""
    return effect.since <= 0 and effect.until == inf
