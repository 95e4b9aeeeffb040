"""How far the balances of a run are off."""

import numpy as np

import rigidfx as rf

TINY = float(np.finfo(np.float64).tiny)


class Balance:
    """Errors of energy and momenta so far.

    Attributes:
        off: Largest |H - H(0) - work + dissipated| [J].
        gain: Of the last step [J].
        largest: Largest H, or work of a step [J].
        touching: Steps in which a contact stored energy.
        steps: All steps.
    """

    def __init__(self) -> None:
        """Begin with nothing."""
        self.off = self.gain = self.largest = 0.0
        self.touching = self.steps = 0
        self._first: rf.Report | None = None
        self._now = self._expected = 0.0  # the error, and what work has given [J]
        self._changes, self._sizes = np.zeros(2), np.full(2, TINY)

    @property
    def energy(self) -> float:
        """Error of the energy over the largest energy."""
        return self.off / max(self.largest, TINY)

    @property
    def momenta(self) -> tuple[float, float]:
        """Largest change of L relative to Σ m|v|, and of J about the origin to its own size."""
        linear, angular = self._changes / self._sizes
        return float(linear), float(angular)

    def follow(self, r: rf.Report) -> None:
        """Take note of a report."""
        first = self._first = r if self._first is None else self._first
        if r is not first:
            self.steps += 1
            self.touching += any(touch.energy > 0 for touch in r.touches.values())
            self._expected += r.supplied
        now = r.energy - first.energy - self._expected
        self.gain, self._now = now - self._now, now
        self.off = float(np.maximum(self.off, abs(now)))  # of what is no number, too
        self.largest = max(self.largest, r.energy, abs(r.supplied))
        L, J = r.linear_momentum, r.angular_momentum
        changes = L - first.linear_momentum, J - first.angular_momentum
        self._changes = np.maximum(self._changes, np.linalg.norm(changes, axis=1))
        self._sizes = np.maximum(self._sizes, [r.momentum_scale, np.linalg.norm(J)])
