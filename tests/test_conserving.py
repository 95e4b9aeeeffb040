"""A step keeps energy and momenta whatever its Δt: what a residual takes, and when it is enough.

Run as a script under mpirun, this file reports what residuals take.
"""

from __future__ import annotations

import numpy as np
import parallel
import pytest
from histories import column, drift, show
from mpi4py import MPI

import rigidfx as rf
from rigidfx.step.equations.round_off import Lost

STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7800.0)
NEWTON = {"snes_lag_jacobian": 1}


# The rule --------------------------------------------------------------------------------------


def follow(iterates, rule, kept=False):
    """Number of iterates that are followed up to the end, and the one that is taken."""
    rule.restart()
    best = 0
    for k, (residual, *lost) in enumerate(iterates):
        if rule.following and rule.grown(residual):
            return k + 1, best
        enough = rule.enough(residual, np.array(lost), kept)
        best = k if rule.best else best
        if enough:
            return k + 1, best
    return -1, best


# What is measured ------------------------------------------------------------------------------


def turning(*effects, velocity=1.0, cells=(8, 2, 2), **options):
    """A bar of steel that turns, and bends to and fro."""
    bar = rf.box((0, 0, 0), (1, 0.2, 0.2), cells)
    bar = bar.with_cells("end", lambda x: x[0] > 0.8)

    def bending(x):
        return velocity * np.outer([0, 0, 1], np.cos(2 * np.pi * x[0]))

    start = rf.InitialVelocity(angular=(1.0, 4.0, 0.5), function=bending)
    return rf.Scene(bar, STEEL, [start, *effects], **options)


def changing(steps, seed=1):
    """A run's Δt, another one in each step, and its end [s]."""
    dts = np.exp(np.random.default_rng(seed).uniform(np.log(1e-5), np.log(1e-2), steps))
    ends = np.cumsum(dts)
    return dict(zip([0.0, *ends], dts, strict=False)), ends[-1]


def taken(*effects, **options):
    """What steps were off by, and what was said of that, shape (steps, 3) each [J, Ns, Nms]."""
    said, usual = [], Lost.of_all

    def watched(self, dt, y, R, x, *scales):
        lost = usual(self, dt, y, R, x, *scales)
        units = self._energy, self._momentum, self._momentum * self._size
        at = x[self._p.free[::3] // 3]
        count, *places = self._p.comm.allreduce(np.array([len(at), *at.sum(axis=0)]))
        said.append((lost * units, np.array(places) / count))
        return lost

    off, kept, before = [], [], None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Lost, "of_all", watched)
        # So loose that more than rounding is left.
        loose = {"snes_rtol": 1e-3, **NEWTON}
        for report in rf.simulate(turning(*effects, **options), 1e-3, 2e-2, petsc_options=loose):
            now = report.energy, report.linear_momentum, report.angular_momentum
            if before is not None:
                H, L, J = (a - b for a, b in zip(now, before, strict=True))
                lost, middle = said[-1]
                turn = J - np.cross(middle, L)
                off.append([abs(H), np.linalg.norm(L), np.linalg.norm(turn)])
                kept.append(lost)
            before = now
    return np.array(off), np.array(kept)


@pytest.mark.parametrize("effects", [(), (rf.Rigid("end"),)], ids=["flexible", "rigid end"])
@pytest.mark.parametrize("options", [{}, {"mass": "consistent"}], ids=["lumped", "consistent"])
def test_what_a_residual_takes_is_what_the_step_is_off_by(effects, options):
    off, said = taken(*effects, **options)
    largest, apart = off.max(axis=0), np.abs(off - said).max(axis=0)
    for name, most, difference in zip(("H", "L", "J"), largest, apart, strict=True):
        show(**{name: most, "apart": difference})
        assert difference <= 1e-5 * most


# In runs ---------------------------------------------------------------------------------------


MOTIONS = {
    "free": lambda: turning(),
    "rigid end": lambda: turning(rf.Rigid("end")),
    "enhanced": lambda: turning(element="enhanced"),
    "second order": lambda: turning(cells=(6, 1, 1), order=2, mass="consistent"),
}


RUNS = [("free", {}, 500), ("free", NEWTON, 150)]
RUNS += [(name, {}, 150) for name in MOTIONS if name != "free"]


@pytest.mark.parametrize(("name", "method", "steps"), RUNS)
def test_energy_and_momenta_stay_through_changes_of_the_time_step(name, method, steps):
    """By up to a thousand times each; it was 1e-10 and more by kept tangents."""
    dt, t_end = changing(steps)
    reports = list(rf.simulate(MOTIONS[name](), dt, t_end, petsc_options=method))
    assert len(reports) == steps + 1
    H, J, L = (column(reports, k) for k in ("energy", "angular_momentum", "linear_momentum"))
    L = np.linalg.norm(L, axis=1).max() / reports[0].momentum_scale
    show(H=drift(H), J=drift(J), L=L, iterations=column(reports, "iterations")[1:].mean())
    assert max(drift(H), drift(J), L) <= 1e-11


@pytest.mark.parallel
def test_several_ranks_know_the_same():
    for (off, said), effects in zip(parallel.run(__file__, 2, 120), EFFECTS, strict=True):
        apart = np.abs(np.array(off) - said).max(axis=0)
        show(ranks=2, bodies=len(effects), H=apart[0], L=apart[1], J=apart[2])
        assert (apart <= 1e-5 * np.max(off, axis=0)).all()


EFFECTS = (), (rf.Rigid("end"),)

if __name__ == "__main__":
    found = [[part.tolist() for part in taken(*effects)] for effects in EFFECTS]
    if MPI.COMM_WORLD.rank == 0:
        parallel.report(found)
