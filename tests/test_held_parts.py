"""Parts named rigid that supports hold: what they take from the compliance is told, once.

Run as a script under mpirun, this file reports what a run warns of.
"""

from __future__ import annotations

import re
import warnings

import numpy as np
import parallel
import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.decide.memory.compliance import Compliance
from rigidfx.shadow.margin import Margin
from rigidfx.shadow.shadow import Shadow

COMM = MPI.COMM_WORLD
DT, T = 0.2, 60.0  # s, and s of the slow load
SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)
STIFF = rf.StVenantKirchhoff(E=3e6, nu=0.3, rho=1000.0)
CLAMP = rf.Fixed("x0")
DRAG = rf.MassDamping(2.0)


def slowly(t):
    return np.sin(2 * np.pi * t / T)


def drift(t):
    return 1e-3 * t, 0.0, 0.0


WALL = rf.Contact("x0", against=rf.Plane((0, 0, 0), (1, 0, 0)), stiffness=3e5)
PUSH = rf.Traction("x1", (0, 0, 50.0), time=slowly)


def bar(*effects, root=STIFF, cells=(8, 1, 1), **options):
    """A bar of 4 m × 1 m × 1 m; its first half, the root, is what supports hold."""
    box = rf.box((0, 0, 0), (4, 1, 1), cells, options.pop("cell", "hexahedron"))
    box = box.with_cells("root", lambda x: x[0] <= 2 + 1e-9)
    box = box.with_cells("rest", lambda x: x[0] >= 2 - 1e-9)
    probes = {"tip": (4, 0.5, 0.5)}
    return rf.Scene(box, {"root": root, "rest": SOFT}, effects, probes=probes, **options)


def run(scene, t_end, rule=None, dt=DT):
    """Tips, and what was said of the root."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", rf.RigidfxWarning)
        reports = rf.simulate(scene, dt, t_end, rigidify=rule, progress=False)
        tips = np.array([report.probes["tip"] for report in reports])
    return tips, [str(w.message) for w in said if "'root' that is named Rigid" in str(w.message)]


RULE = rf.StrainRate(rf.Relative(0.02), 5 * DT, never=("rest",))
HELD = rf.Rigid("root")


def lacking(said):
    """Part of the compliance that a warning tells of."""
    return float(re.search(r"lacks some ([\d.]+)%", said).group(1)) / 100


@pytest.mark.parametrize(
    ("effects", "options"),
    [
        ((PUSH, CLAMP), {}),
        ((PUSH, CLAMP), {"mass": "consistent"}),
        ((PUSH, CLAMP), {"cell": "tetrahedron"}),
        ((PUSH, CLAMP, rf.Spring("x1", 100.0)), {}),
        ((rf.Gravity((0, 0, -0.3), time=slowly), CLAMP), {}),
        ((rf.Traction("x1", (900.0, 0, 0), time=slowly), CLAMP), {}),
        ((PUSH, rf.PrescribedMotion("x0", displacement=drift)), {}),
        ((rf.Traction("x1", (-900.0, 0, 0), time=slowly), WALL), {}),
    ],
    ids=["push", "consistent", "tetrahedra", "spring", "weight", "axial", "moved", "contact"],
)
def test_what_held_parts_take_is_what_the_twin_shows(effects, options):
    """Under slow loads, within a fifth."""
    t_end = T / 4
    own, said = run(bar(*effects, DRAG, HELD, **options), t_end, RULE)
    twin, silent = run(bar(*effects, DRAG, **options), t_end)
    moves = any(isinstance(effect, rf.PrescribedMotion) for effect in effects)
    base = drift(t_end if moves else 0.0)
    ways = [np.linalg.norm(tips[-1] - tips[0] - base) for tips in (own, twin)]
    assert silent == []
    assert len(said) == 1
    assert "deflections may be off by as much" in said[0]
    assert lacking(said[0]) == pytest.approx(1 - ways[0] / ways[1], rel=0.2)


def test_a_vibration_has_no_bound():
    """Under a sine at the first frequency of what is held, were it flexible."""
    f = 0.1615 / 16 * np.sqrt(1e3)
    sine = rf.Traction("x1", (0, 0, 5.0), time=lambda t: np.sin(2 * np.pi * f * t))
    _, (said,) = run(bar(CLAMP, sine, HELD, root=SOFT), 4.0, RULE)
    assert lacking(said) > 0.5
    assert "nothing bounds what the motion is off by" in said


def test_where_nothing_is_withheld_nothing_is_said():
    """All moves as one; or the part is so stiff that it hardly strains; or nothing moves."""
    v = (0.1, 0.2, 0.0)
    moved = rf.PrescribedMotion("x0", displacement=lambda t: np.multiply(v, t))
    rule = rf.StrainRate(1e-6, 5 * DT, never=("rest",))
    assert run(bar(moved, rf.InitialVelocity(linear=v), HELD), 4.0, rule)[1] == []
    hard = rf.StVenantKirchhoff(E=1e9, nu=0.3, rho=1000.0)
    assert run(bar(PUSH, CLAMP, DRAG, HELD, root=hard), 4.0, RULE)[1] == []
    assert run(bar(CLAMP, HELD), 4.0, rule)[1] == []


def test_a_part_is_watched_from_when_a_support_holds_it():
    """And as it is turned, in its own frame."""
    held = rf.Fixed("x0", since=2.0)
    _, (said,) = run(bar(PUSH, held, DRAG, HELD), T / 4, RULE)
    assert 0 < lacking(said) < 1

    turns = rf.Resultant("root", torque=(1.0, 0, 0), until=1.0)
    _, (said,) = run(bar(PUSH, held, DRAG, HELD, turns), T / 4, RULE)
    assert 0 < lacking(said) < 1

    def angle(t):
        return 0.5 * np.sin(2 * np.pi * t / T)

    turned = rf.PrescribedRotation("x0", axis=(0, 0, 1), angle=angle)
    push = rf.Traction("x1", (0, 0, 50.0), time=slowly)
    _, (said,) = run(bar(push, turned, DRAG, HELD), T / 4, RULE)
    _, (still,) = run(bar(push, CLAMP, DRAG, HELD), T / 4, RULE)
    assert lacking(said) == pytest.approx(lacking(still), rel=0.05)


def test_what_holds_in_some_directions_holds_margins(monkeypatch):
    """On rollers: none of the body's own nodes is held where these do."""
    found, held = [], Margin.held

    def seen(self):
        found.append((self, held(self)))
        return found[-1][1]

    monkeypatch.setattr(Margin, "held", seen)
    rollers = [rf.Fixed("x0", "x"), rf.Fixed("y0", "y"), rf.Fixed("z0", "z")]
    box = rf.box((0, 0, 0), (4, 2, 2), (8, 4, 4))
    box = box.with_cells("inner", lambda x: x.min(axis=0) >= 0.5 - 1e-9)
    scene = rf.Scene(box, SOFT, [*rollers, rf.Rigid("inner")])
    list(rf.simulate(scene, DT, DT, rigidify=rf.StrainRate(1e-6, 1.0), progress=False))
    ((margin, rows),) = found
    assert margin.supported.tolist() == (margin.rows.X < 1e-9).tolist()
    assert np.array_equal(np.sort(rows), np.flatnonzero(margin.supported))


def test_shadows_of_held_parts_cost_nothing_where_there_are_none(monkeypatch):
    made, begin = [], Shadow.__init__

    def counted(self, *given):
        made.append(self)
        begin(self, *given)

    monkeypatch.setattr(Shadow, "__init__", counted)
    beside = rf.Fixed("x1")
    for effects, shadows in (
        ((PUSH, CLAMP), 1),
        ((PUSH, HELD, beside), 1),
        ((PUSH, HELD, CLAMP), 2),
    ):
        made.clear()
        run(bar(*effects), DT, RULE)
        assert len(made) == shadows


def test_what_has_been_told_is_looked_at_no_more(monkeypatch):
    looks, look = [], Shadow.look

    def counted(self, t, *given):
        looks.append(t)
        return look(self, t, *given)

    monkeypatch.setattr(Shadow, "look", counted)
    blow = rf.Traction("x1", (0, 0, 50.0), time=lambda t: float(t < 2.0))
    _, said = run(bar(blow, CLAMP, rf.MassDamping(20.0), HELD), 16.0, RULE)
    assert len(said) == 1
    assert looks.count(0.0) == 2  # of bodies, and of what is held
    assert looks.count(max(looks)) == 1


def test_what_is_told_is_what_the_energies_say():
    """Half of the compliance; it is told once the motion has not grown for as long as before."""
    compliance = Compliance()
    for t in range(1, 6):
        compliance.look({"root": min(t, 3.0)})
        compliance.add(0.01 * t, min(t, 3.0), float(t))
        assert not compliance.settled
    compliance.look({"root": 2.0})
    compliance.add(0.0, 1.0, 6.0)
    assert compliance.settled
    assert compliance.taken("root") == pytest.approx(0.5)
    assert compliance.taken("other") == 0
    assert not compliance.vibrates("root")
    compliance.add(0.4, 1.0, 7.0)
    assert compliance.vibrates("root")
    assert not compliance.vibrates("other")


def on_ranks():
    """What is said of a held part on these ranks."""
    return run(bar(PUSH, CLAMP, DRAG, HELD), 8 * DT, RULE)[1]


@pytest.mark.parallel
def test_two_ranks_say_the_same():
    assert parallel.run(__file__, 2, 300) == on_ranks()


if __name__ == "__main__":
    told = on_ranks()
    if COMM.rank == 0:
        parallel.report(told)
