"""When Newton stops: a rule from norms to reasons, and runs whose residuals end in rounding."""

from __future__ import annotations

import numpy as np
import pytest
from histories import EPS, column, drift, imbalance, show

import rigidfx as rf
from rigidfx.step.newton.newton import Newton
from rigidfx.step.newton.stopping_test import ROUNDING, StoppingTest


@pytest.mark.parametrize(
    ("norms", "ends"),
    [
        ([1e-9], False),  # a first guess, unless it is exact
        ([0.0], True),
        ([1e2, 1e-3, 1e-7], True),  # quadratic: what the next iterate would leave is nothing
        ([1e2, 1e-1, 1e-7], False),
        ([1e-3, 1e-1, 5e-6, 4e-6], True),  # a stall; the level is an estimate,
        ([1e-3, 1e-1, 5e-4, 4e-4], False),  # but no worse than this
        ([1e-3, 1e-1, 3e-7, 9e-7], True),  # growth is a stall below the level only
        ([1e-3, 1e-1, 3e-6, 9e-6], False),
        ([1.0, 1e-3, np.nan], True),
        ([1.0, 1e12], True),  # beyond the forces that it is the difference of
    ],
)
def test_an_iteration_ends_at_the_rounding_of_its_forces(norms, ends):
    """Residuals below 1 µN are rounding here."""
    stop = StoppingTest()
    stop.expect_rounding(1e-6 / (ROUNDING * EPS))
    stop.restart()
    reasons = [stop(k, norm) for k, norm in enumerate(norms)]
    assert not any(reasons[:-1])
    assert bool(reasons[-1]) == ends


@pytest.mark.filterwarnings("ignore:In the step from:rigidfx.RigidfxWarning")
def test_no_step_ends_in_a_grown_residual(monkeypatch):
    """Halves of 1e10 : 1 in stiffness: all that Newton leaves is rounding."""
    ended, usual = [], Newton.solve

    def watched(self, guesses):
        found = usual(self, guesses)
        if found.converged:
            ended.append((self.stop.rounding, self.stop.history[-2], self._left))
        return found

    monkeypatch.setattr(Newton, "solve", watched)
    ends = {"stiff": lambda x: x[0] <= 2 + 1e-9, "soft": lambda x: x[0] >= 2 - 1e-9}
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
    for name, where in ends.items():
        domain = domain.with_cells(name, where)
    materials = {
        name: rf.StVenantKirchhoff(E=E, nu=0.3, rho=10.0)
        for name, E in (("stiff", 1e14), ("soft", 1e4))
    }
    spin = rf.InitialVelocity(angular=(2.0, 0.3, 0.1))
    scene = rf.Scene(domain, materials, [spin], order=2, mass="consistent")
    reports = list(rf.simulate(scene, 0.05, 3.0))
    H = drift(column(reports, "energy"))
    show(H=H, most=max(r.iterations for r in reports))
    assert len(ended) == 60
    assert not [(level, before, last) for level, before, last in ended if last > max(level, before)]
    assert sum(r.cuts for r in reports) == 0
    # Four are for what the residual takes from energy and momenta, at most; 5 would do without.
    assert max(r.iterations for r in reports) <= 10
    # Forces of rounding, ε E₁, move with the soft half. It was 3e-5 where grown residuals were
    # accepted, and 1.5e-10 to 4e-7, as the processor's last bits decided, where rounding alone
    # ended a step.
    assert H <= 1e-9


@pytest.mark.filterwarnings("ignore:Up to t = .* goes back and forth")  # as it does
@pytest.mark.filterwarnings("ignore:Vibrations of")  # and is damped far beyond them
@pytest.mark.filterwarnings("ignore:simulate. a wave needs")  # at the shortest steps
@pytest.mark.parametrize("dt", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("start", ["kick", "load"])
def test_viscous_stress_far_above_the_elastic_one(dt, start):
    """η/(E Δt) = 1e6: Newton ends at the rounding of viscous forces, which is small."""
    E = 2e11
    how = {
        "load": rf.Traction("x1", (0.0, 0.0, 1e5)),
        "kick": rf.InitialVelocity(function=lambda X: 0.1 * np.outer([0, 0, 1], X[0])),
    }
    effects = [rf.Fixed("x0"), rf.KelvinVoigt(1e6 * E * dt), how[start]]
    steel = rf.StVenantKirchhoff(E=E, nu=0.3, rho=7850.0)
    scene = rf.Scene(rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)), steel, effects)
    reports = list(rf.simulate(scene, dt, 20 * dt))
    off = imbalance(reports)
    show(most=max(r.iterations for r in reports), off=off)
    assert sum(r.cuts for r in reports) == 0
    assert max(r.iterations for r in reports) <= 4
    assert off <= 1e-5  # strains of the load are 1e-12 and less
