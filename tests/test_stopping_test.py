"""When Newton stops: a pure rule from norms to reasons, and what it is worth in runs."""

from __future__ import annotations

import numpy as np
import pytest
from histories import EPS, column, drift, show

import rigidfx as rf
from rigidfx.step.newton.newton import Newton
from rigidfx.step.newton.stopping_test import ROUNDING, StoppingTest, reason_name

LEVEL = 1e-6  # N


def at_level(rounding: float = LEVEL, **options: float) -> StoppingTest:
    """A test that takes residuals below so many newtons for rounding."""
    stop = StoppingTest(**options)
    stop.expect_rounding(rounding / (ROUNDING * EPS))
    return stop


def end(norms: list[float], stop: StoppingTest | None = None) -> tuple[int, str]:
    """Iterate at which a sequence of norms ends, and why; -1 if it does not."""
    stop = stop or at_level()
    stop.restart()
    for iteration, norm in enumerate(norms):
        reason = stop(iteration, norm)
        if reason:
            return iteration, reason_name(reason)
    return -1, ""


ROUNDED, REDUCED = "converged_fnorm_abs", "converged_fnorm_relative"


def test_first_guess_is_never_taken_for_a_solution():
    """Forces that move a stiff body as a whole may be far below rounding in its strains."""
    assert end([1e-9]) == (-1, "")
    assert end([0.0]) == (0, ROUNDED)  # unless it is one


def test_quadratic_convergence_to_below_rounding():
    """What the next iterate would leave is known to be nothing: it is not computed."""
    assert end([1e2, 1e-3, 1e-7]) == (2, ROUNDED)  # 1e-13, less than 1e-12 of 1e2
    assert end([1e2, 1e-1, 1e-7]) == (-1, "")  # 1e-7


def test_slow_decrease_at_rounding_is_a_stall():
    assert end([1e-3, 1e-1, 5e-7, 4e-7]) == (3, ROUNDED)
    assert end([1e-3, 1e-1, 5e-6, 4e-6]) == (3, ROUNDED)  # the level is an estimate ...
    assert end([1e-3, 1e-1, 5e-4, 4e-4]) == (-1, "")  # ... but no worse than this


def test_growth_is_a_stall_only_below_the_rounding_level():
    assert end([1e-3, 1e-1, 3e-7, 9e-7]) == (3, ROUNDED)
    assert end([1e-3, 1e-1, 3e-7, 2e-6]) == (-1, "")
    assert end([1e-3, 1e-1, 3e-6, 9e-6]) == (-1, "")
    assert end([9.2, 3e5, 0.54, 66.0], at_level(0.9)) == (-1, "")
    assert end([9.2, 3e5, 2.2, 280.0], at_level(3.5)) == (-1, "")


def test_return_to_rounding_ends_what_rounding_has_thrown_out():
    assert end([1e-3, 1e-1, 5e-7, 2e-2, 8e-7]) == (4, ROUNDED)
    # Of a first iterate below rounding that says nothing: its growth may be the motion's.
    assert end([5e-7, 2e-2, 8e-7]) == (-1, "")


@pytest.mark.parametrize("norm", [np.nan, np.inf])
@pytest.mark.parametrize("before", [[], [1.0], [1.0, 1e-3]])
def test_residual_that_is_not_finite(norm, before):
    assert end([*before, norm]) == (len(before), "diverged_dtol")


def test_growth_beyond_all_bounds():
    """Beyond 1e6 times the first residual, and beyond the forces that it is the difference of."""
    forces = LEVEL / (ROUNDING * EPS)
    assert end([1e6, 1e12]) == (-1, "")
    assert end([1e6, 1.1e12]) == (1, "diverged_dtol")
    assert end([1.0, 0.9 * forces]) == (-1, "")
    assert end([1.0, 1.1 * forces]) == (1, "diverged_dtol")


# In runs ----------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:In the step from:rigidfx.RigidfxWarning")
def test_no_step_ends_in_a_grown_residual(monkeypatch):
    """Halves of 1e10 : 1 in stiffness: all that Newton leaves is rounding."""
    ended, usual = [], Newton.accept

    def watched(self):
        ended.append((self.stop.rounding, self.stop.history[-2], self._left))
        usual(self)

    monkeypatch.setattr(Newton, "accept", watched)
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
    given = np.cumsum([r.work_of_loads - sum(r.dissipated.values()) for r in reports])
    off = np.ptp(column(reports, "energy") - given) / max(np.abs(given).max(), reports[0].energy)
    show(most=max(r.iterations for r in reports), off=off)
    assert sum(r.cuts for r in reports) == 0
    assert max(r.iterations for r in reports) <= 4
    assert off <= 1e-5  # strains of the load are 1e-12 and less
