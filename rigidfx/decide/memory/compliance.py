"""What parts named rigid take from the compliance of a structure.

Under loads F that a structure follows as if at rest, it moves by u where it would by ũ, and

    F·u = 2U,    F·(ũ - u) = ρᵀ K⁺ρ = 2W,

for what is left out of its equations is ρ, which does no work on u: U is the strain energy that it
has, W what a part withholds (Castigliano). So the part takes W/(U + W) of the compliance, in the
mean over the loads, and of a vibration as much from the squares of its periods (Rayleigh). How far
a vibration is off in the end nothing bounds: its phases drift apart, and near a resonance any
difference is a large one. Kinetic energy tells one from the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from rigidfx.base.remembered import Remembered, same

__all__ = ["Compliance"]

SLOW = 0.2  # of the largest strain energy: the largest kinetic one of what follows its loads
GROWN = 1.1  # times what energies were, by which a motion grows


class Compliance:
    """Largest energies so far, equal on all ranks.

    Attributes:
        exceeded: By its name, how often over what wakes other cells a part was first strained, and
            the time [s].
    """

    remembered: ClassVar[Remembered] = same(
        "exceeded", "_withheld", "_both", "_shares", "_strain", "_kinetic", "_size", "_grew", "_t"
    )

    def __init__(self) -> None:
        """Nothing has moved."""
        self.exceeded: dict[str, tuple[float, float]] = {}
        self._withheld: dict[str, float] = {}  # in the present step, if it was looked at, and
        self._both: dict[str, tuple[float, float]] = {}  # with U, when these were largest together
        self._shares: dict[str, float] = {}  # of W that are left in the whole structure
        self._strain = self._kinetic = 0.0
        self._size, self._grew, self._t = 0.0, 0.0, 0.0  # energy when it last grew, and when

    def add(self, kinetic: float, strain: float, t: float) -> None:
        """Take note of energies of deformation after a step [J], at t [s]."""
        self._strain, self._t = max(self._strain, strain), t
        self._kinetic = max(self._kinetic, kinetic)
        size = max([self._strain, self._kinetic, *self._withheld.values()])
        for name, energy in self._withheld.items():
            self._both[name] = max(self._both.get(name, (0.0, 0.0)), (energy, strain), key=sum)
        self._withheld = {}
        if size > GROWN * self._size:
            self._size, self._grew = size, t

    @property
    def settled(self) -> bool:
        """Whether the motion has not grown for as long as it has gone on."""
        return self._t >= 2 * self._grew

    def look(self, withheld: Mapping[str, float]) -> None:
        """Take note of what parts withhold in a step, by their names [J]."""
        self._withheld.update(withheld)

    def shares(self, name: str, part: float) -> None:
        """Take note of what part of W a part named rigid withholds in the whole structure."""
        self._shares[name] = part

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parts that have been looked at."""
        return tuple(self._both)

    def exceeds(self, name: str, ratio: float, t: float) -> None:
        """Take note that a part is strained by more than wakes others, at t [s]."""
        self.exceeded.setdefault(name, (ratio, t))

    def taken(self, name: str) -> float:
        """W/(U + W) of a part: not every step is looked at, so both are of one."""
        energy, strain = self._both.get(name, (0.0, 0.0))
        energy *= self._shares.get(name, 1.0)
        return energy / (energy + strain) if energy > 0 else 0.0

    def vibrates(self, name: str) -> bool:
        """Whether the structure would vibrate without a part, in place of following its loads.

        It follows them the less, the more compliance it has.
        """
        return self._kinetic > SLOW * (1 - self.taken(name)) * self._strain
