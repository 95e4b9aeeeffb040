"""Parts named rigid that supports hold: what they take from the compliance is told, once.

Run as a script under mpirun, this file reports what a run warns of.
"""

import numpy as np
import parallel
import pytest
from common import boxes
from histories import heard
from mpi4py import MPI

import rigidfx as rf
import rigidfx.withheld.recovery
from rigidfx.flexible.stress import CauchyStress

COMM = MPI.COMM_WORLD
DT, T = 0.2, 60.0  # s, and s of the slow load
SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)
STIFF = rf.StVenantKirchhoff(E=3e6, nu=0.3, rho=1000.0)
CLAMP = rf.Fixed("x0")
DRAG = rf.MassDamping(2.0)


def slowly(t):
    return np.sin(2 * np.pi * t / T)


def drift(t):
    return 1e-4 * t**2, 0.0, 0.0


WALL = rf.Contact("x0", against=rf.Plane((0, 0, 0), (1, 0, 0)), stiffness=3e5)


def floor(speed=0.0, **friction):
    """A floor below the bar that runs along it [m/s]."""
    below = rf.Plane((0, 0, 0), (0, 0, 1), path=lambda t: (speed * t, 0.0, 0.0))
    return rf.Contact("z0", against=below, stiffness=3e5, **friction)


FLOOR = floor()
PUSH = rf.Traction("x1", (0, 0, 50.0), time=slowly)


def bar(*effects, root=STIFF, cells=(8, 1, 1), **options):
    """A bar of 4 m × 1 m × 1 m; its first half, the root, is what supports hold."""
    box = rf.box((0, 0, 0), (4, 1, 1), cells, options.pop("cell", "hexahedron"))
    box = box.with_cells("root", lambda x: x[0] <= 2 + 1e-9)
    box = box.with_cells("rest", lambda x: x[0] >= 2 - 1e-9)
    probes = {"tip": (4, 0.5, 0.5)}
    return rf.Scene(box, {"root": root, "rest": SOFT}, effects, probes=probes, **options)


def ended(scene, t_end, rule=None, dt=DT):
    """Tips, what was said of the root, and the last report."""
    tips = []
    with heard("'root' that is named Rigid") as said:
        for report in rf.simulate(scene, dt, t_end, rigidify=rule, progress=False):
            tips += [report.probes["tip"]]
    return np.array(tips), said, report


def run(*given):
    """Tips, and what was said of the root."""
    return ended(*given)[:2]


RULE = rf.StrainRate(rf.Relative(0.02), 5 * DT, never=("rest",))
HELD = rf.Rigid("root")


@pytest.mark.parametrize(
    ("effects", "options"),
    [
        ((PUSH, CLAMP), {}),
        ((PUSH, CLAMP), {"mass": "consistent"}),
        ((PUSH, CLAMP), {"cell": "tetrahedron"}),
        ((PUSH, CLAMP, rf.Spring("x1", 100.0)), {}),
        ((rf.Gravity((0, 0, -0.1), time=slowly), CLAMP), {}),
        ((rf.Traction("x1", (900.0, 0, 0), time=slowly), CLAMP), {}),
        ((PUSH, rf.PrescribedMotion("x0", displacement=drift)), {}),
        ((rf.Traction("x1", (-900.0, 0, 0), time=slowly), WALL), {}),
    ],
    ids=["push", "consistent", "tetrahedra", "spring", "weight", "axial", "moved", "contact"],
)
def test_stresses_of_held_parts_are_the_twins(effects, options):
    """Under slow loads: stresses within 5 % in the mean."""
    t_end, scene = T / 4, bar(*effects, DRAG, HELD, **options)
    *_, last = ended(scene, t_end, RULE)
    flexible = bar(*effects, DRAG, **options)
    *_, last_of_twin = ended(flexible, t_end)
    carried, recovered = rf.recovered_stress(last, CauchyStress(scene))
    exact, none = rf.recovered_stress(last_of_twin, CauchyStress(flexible))
    assert not none.any()
    assert np.array_equal(np.flatnonzero(recovered), scene.owned_cells("root", ""))
    sizes = np.linalg.norm([carried - exact, exact], axis=(2, 3))[:, recovered].sum(axis=1)
    assert sizes[0] < 0.05 * sizes[1]


GRAVITY = rf.Gravity((0, 0, -0.5), time=slowly)
VISCOUS = rf.StiffnessDamping(ratio=0.2, frequency=0.5), rf.NumericalDamping(0.35)
PRESS = rf.Traction("x1", (0, 0, -50.0), time=slowly)


@pytest.mark.parametrize(
    ("effects", "name"),
    [
        ((PUSH, CLAMP, rf.Spring("x1", 3000.0)), "root"),
        ((GRAVITY, CLAMP, rf.Fixed("x1", "z"), rf.Spring("x1", 300.0)), "root"),
        ((GRAVITY, CLAMP, FLOOR), "root"),
        ((PRESS, CLAMP, FLOOR), "rest"),
        ((GRAVITY, PRESS, CLAMP, floor(friction=0.3, creep=1e-3)), "root"),
        ((GRAVITY, PRESS, CLAMP, floor(0.01, friction=0.3, creep=1e-5)), "root"),
        ((GRAVITY, CLAMP, rf.Spring("x1", 3000.0), *VISCOUS), "root"),
        ((rf.Gravity((0, 0, -2.0), time=slowly), CLAMP), "root"),
        ((rf.Traction("x1", (2e5, 0, 0), time=slowly), CLAMP, rf.Spring("x1", 1e5)), "root"),
    ],
    ids=[
        *("spring", "second support", "floor", "free on a floor", "friction", "belt"),
        *("viscous", "bent far", "pulled far"),
    ],
)
def test_what_parts_carry_is_that_of_the_whole_structure(effects, name):
    """Within 3 % of the twin's stress in the mean."""
    scene, flexible = bar(*effects, DRAG, rf.Rigid(name), root=SOFT), bar(*effects, DRAG, root=SOFT)
    rule = rf.StrainRate(rf.Relative(0.02), 5 * DT, never=("root", "rest"))
    last, last_of_twin = ended(scene, T / 4, rule)[2], ended(flexible, T / 4)[2]
    exact, _ = rf.recovered_stress(last_of_twin, CauchyStress(flexible))

    carried, recovered = rf.recovered_stress(last, CauchyStress(scene))
    assert np.array_equal(np.flatnonzero(recovered), scene.owned_cells(name, ""))
    sizes = np.linalg.norm([carried - exact, exact], axis=(2, 3))[:, recovered].sum(axis=1)
    assert sizes[0] < 0.03 * sizes[1]


@pytest.mark.filterwarnings("ignore:StrainRate. forces would:rigidfx.RigidfxWarning")
def test_what_a_part_on_another_surface_carries():
    """A bar that comes to lie on another one, both clamped; they close by what each gives way."""
    gap = 1e-3
    both = ((0, 0, 0), (4, 1, 1), (8, 1, 1)), ((0, 0.1, 1 + gap), (4.2, 0.9, 2 + gap), (8, 1, 1))
    domain = boxes(*both).with_cells("root", lambda x: (x[2] > 1 + gap / 2) & (x[0] < 2.2))
    domain = domain.with_cells("rest", lambda x: (x[2] < 1 + gap / 2) | (x[0] > 2.0))
    for name, z in {"lower": 1.0, "upper": 1 + gap}.items():
        domain = domain.with_facets(name, lambda x, z=z: abs(x[2] - z) < 1e-9)
    for name, at in {"left": 0.0, "end": 4.2}.items():
        domain = domain.with_facets(name, lambda x, at=at: abs(x[0] - at) < 1e-9)
    meets = rf.Contact("upper", against="lower", stiffness=3e5)
    press = rf.Traction("end", (0, 0, -50.0), time=slowly)
    effects = GRAVITY, press, rf.Fixed("left"), meets, DRAG
    scene, flexible = (rf.Scene(domain, SOFT, [*effects, *held]) for held in ([HELD], []))
    (*_, last) = rf.simulate(scene, DT, T / 4, rigidify=RULE, progress=False)
    (*_, twin) = rf.simulate(flexible, DT, T / 4, progress=False)
    assert twin.touches["upper_lower"].nodes > last.touches["upper_lower"].nodes == 0
    carried, recovered = rf.recovered_stress(last, CauchyStress(scene))
    exact, _ = rf.recovered_stress(twin, CauchyStress(flexible))
    sizes = np.linalg.norm([carried - exact, exact], axis=(2, 3))[:, recovered].sum(axis=1)
    assert recovered.any()
    assert sizes[0] < 0.01 * sizes[1]


def test_a_run_that_an_error_has_ended_may_be_asked_what_held_parts_carry():
    """Of what was solved last its equations know nothing any more: nothing is recovered."""

    def failing(t):
        if t > 4.2:
            raise RuntimeError("boom")
        return slowly(t)

    scene = bar(rf.Traction("x1", (0, 0, 50.0), time=failing), CLAMP, DRAG, HELD)
    with pytest.raises(rf.SceneError, match="boom"):
        for report in rf.simulate(scene, DT, T, rigidify=RULE, progress=False):  # noqa: B007
            pass
    assert not rf.recovered_stress(report, CauchyStress(scene))[1].any()


def on_ranks():
    """The stress in a held part on these ranks."""
    sums = []
    for beside in ((), (rf.Spring("x1", 3000.0),)):
        scene = bar(PUSH, CLAMP, DRAG, HELD, *beside)
        *_, report = ended(scene, 8 * DT, RULE)
        found, recovered = rf.recovered_stress(report, CauchyStress(scene))
        sums += [COMM.allreduce(found[recovered].sum(axis=0)).tolist()]
    return sums


@pytest.mark.parallel
def test_ranks_find_the_same():
    carried = parallel.run(__file__, 3, 300)
    assert np.array(carried) == pytest.approx(np.array(on_ranks()), rel=1e-8, abs=1e-6)


if __name__ == "__main__":
    told = on_ranks()
    if COMM.rank == 0:
        parallel.report(told)
