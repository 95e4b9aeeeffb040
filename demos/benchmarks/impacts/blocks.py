"""What the cases share: a block over a floor, and the balance of energy."""

from __future__ import annotations

import numpy as np

import rigidfx as rf

SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)
FLOOR = rf.Plane((0, 0, 0), (0, 0, 1))


def block(*effects: rf.Effect, above: float = 0.02, mass: str = "lumped") -> rf.Scene:
    """A block over the floor, all of its boundary named."""
    domain = rf.box((0, 0, above), (0.4, 0.2, above + 0.2), (4, 2, 2))
    domain = domain.with_cells("part", lambda x: x[0] <= 0.2 + 1e-9)
    domain = domain.with_cells("all", lambda x: x[0] > -1)
    domain = domain.with_facets("skin", lambda x: np.full(x.shape[1], True))
    return rf.Scene(domain, SOFT, effects, mass=mass)


class Balance:
    """How far energy and momenta of a run are off, relative to their largest values.

    Attributes:
        energy: |H - H(0) - work + dissipated| by the largest H.
        linear: Change of the linear momentum, of what is free.
        angular: Change of the angular momentum about the origin, likewise.
        touching: Steps in which a contact stored energy.
        steps: All steps.
    """

    def __init__(self, free: bool = False) -> None:
        """Begin with nothing; momenta count if nothing acts from outside."""
        self._free = free
        self.energy = self.linear = self.angular = 0.0
        self.touching = self.steps = 0
        self._first: rf.Report | None = None
        self._expected, self._largest, self._scale = 0.0, 0.0, 0.0

    def follow(self, r: rf.Report) -> None:
        """Take note of a report."""
        if self._first is None:
            self._first = r
        first = self._first
        self._largest = max(self._largest, r.energy)
        self._scale = max(self._scale, r.momentum_scale)
        if r is not first:
            self.steps += 1
            self.touching += any(touch.energy > 0 for touch in r.touches.values())
            self._expected += r.work_of_loads + r.work_of_supports - sum(r.dissipated.values())
            self._expected += r.impact.energy if r.impact else 0.0
        off = abs(r.energy - first.energy - self._expected)
        self.energy = max(self.energy, off / self._largest)
        if self._free:
            linear = np.abs(r.linear_momentum - first.linear_momentum).max()
            angular = np.abs(r.angular_momentum - first.angular_momentum).max()
            self.linear = max(self.linear, float(linear) / self._scale)
            self.angular = max(self.angular, float(angular) / self._scale)


def drift(reports: list[rf.Report]) -> float:
    """How far the balance of energy of a run is off."""
    balance = Balance()
    for r in reports:
        balance.follow(r)
    return balance.energy
