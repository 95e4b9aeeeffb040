"""How far the balances of a run are off."""

import numpy as np

import rigidfx as rf


class Balance:
    """Errors of energy and momenta so far.

    Attributes:
        off: Largest |H - H(0) - work + dissipated| [J].
        largest: Largest H [J].
        linear: Change of the linear momentum, of what is free, over its largest scale.
        angular: Change of the angular momentum about the origin, likewise.
        touching: Steps in which a contact stored energy.
        steps: All steps.
    """

    def __init__(self, free: bool = False) -> None:
        """Begin with nothing; momenta count if nothing acts from outside."""
        self._free = free
        self.off = self.largest = self.linear = self.angular = 0.0
        self.touching = self.steps = 0
        self._first: rf.Report | None = None
        self._expected = self._scale = 0.0

    @property
    def energy(self) -> float:
        """Error of the energy over the largest energy."""
        return self.off / self.largest

    def follow(self, r: rf.Report) -> None:
        """Take note of a report."""
        first = self._first = r if self._first is None else self._first
        self.largest = max(self.largest, r.energy)
        self._scale = max(self._scale, r.momentum_scale)
        if r is not first:
            self.steps += 1
            self.touching += any(touch.energy > 0 for touch in r.touches.values())
            self._expected += r.work_of_loads + r.work_of_supports - sum(r.dissipated.values())
            self._expected += r.impact.energy if r.impact else 0.0
        self.off = max(self.off, abs(r.energy - first.energy - self._expected))
        if self._free:
            linear = np.abs(r.linear_momentum - first.linear_momentum).max()
            angular = np.abs(r.angular_momentum - first.angular_momentum).max()
            self.linear = max(self.linear, float(linear) / self._scale)
            self.angular = max(self.angular, float(angular) / self._scale)
