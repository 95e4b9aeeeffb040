"""What somebody adds of his own, without a change of the package: an obstacle, a criterion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import rigidfx as rf
from rigidfx.decide.criteria.judging import Criterion
from rigidfx.decide.criteria.rate_rule import RateRule
from rigidfx.effects.contacts.obstacles import Approach, Obstacle

MATERIAL = rf.StVenantKirchhoff(E=1e5, nu=0.3, rho=1000.0)


@dataclass(frozen=True)
class Floor(Obstacle):
    """All below z = 0."""

    def gap(self, y):
        return y[:, 2]

    def outward(self, y):
        return np.broadcast_to([0.0, 0.0, 1.0], y.shape)

    def approach(self, y0, y1):
        up = self.outward(y0)
        return Approach(up, None, up)


def test_an_obstacle_of_ones_own():
    """It does what the plane that it is does."""
    box = rf.box((0, 0, 0.01), (1, 1, 1.01), (2, 2, 2))
    thrown = rf.InitialVelocity(linear=(0.1, 0.0, -1.0))

    def heights(obstacle):
        contact = rf.Contact("z0", against=obstacle, title="floor")
        scene = rf.Scene(box, MATERIAL, [thrown, contact], probes={"top": (1, 1, 1.01)})
        reports = list(rf.simulate(scene, 0.005, 0.1))
        assert reports[-1].touches["floor"].nodes
        return [report.probes["top"] for report in reports]

    np.testing.assert_array_equal(heights(Floor()), heights(rf.Plane((0, 0, 0), (0, 0, 1))))


@dataclass(frozen=True)
class Patient(Criterion):
    """Everything freezes after a second."""

    wake = "none"
    window = 1.0

    def rule(self, scene, timeline, memory):
        return RateRule(scene, timeline, memory, 1e9, {}, self.window, None)


def test_a_criterion_of_ones_own():
    """It is asked where `StrainRate` would be."""
    scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), MATERIAL)
    reports = list(rf.simulate(scene, 0.25, 1.5, rigidify=Patient()))
    kinds = [(report.t, event.kind) for report in reports for event in report.events]
    assert kinds == [(pytest.approx(1.0), "freeze")]
    assert reports[-1].unknowns == 6


def test_an_accuracy_is_no_criterion_beside_a_time_step():
    scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), MATERIAL)
    with pytest.raises(rf.SceneError, match="rigidify must be a StrainRate"):
        rf.simulate(scene, 0.25, 1.5, rigidify=rf.Accuracy(0.01))
