"""Statics: load paths, what takes part, where runs start, and where paths end."""

import re

import numpy as np
import pytest
from common import boxes
from histories import heard
from parallel import report as tell
from parallel import run as mpirun
from test_modes import chain, swinging

import rigidfx as rf
from rigidfx.output.history import read_history

SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)
RUBBER = rf.NeoHooke(E=1e6, nu=0.3, rho=1000.0)
TIP = (1.0, 0.05, 0.05)


def bar(*effects, material=SOFT, n=(10, 1, 1), **how):
    domain = rf.box((0, 0, 0), (1, 0.1, 0.1), n)
    domain = domain.with_cells("end", lambda x: x[0] > 0.8 - 1e-9)
    domain = domain.with_cells("rest", lambda x: x[0] < 0.8 + 1e-9)
    return rf.Scene(domain, material, effects, probes={"tip": TIP}, **how)


def last(scene, steps=4, **how):
    *_, report = rf.static(scene, steps, **how)
    return report


def energy_is_that_of_the_load(reports, force):
    """The work of a dead load along a path, by the trapezoidal rule, is what the path stores."""
    moved = np.array([r.probes["tip"] for r in reports])
    loads = np.array([r.t for r in reports])[:, None] * np.asarray(force)
    work = np.sum(0.5 * (loads[1:] + loads[:-1]) * np.diff(moved, axis=0))
    return work, reports[-1].energy


@pytest.mark.parametrize(
    "how",
    [
        {"order": 2},
        {"element": "enhanced", "n": (20, 2, 2)},
        {"element": "assumed", "n": (20, 2, 1)},
        {"order": 2, "material": RUBBER},
    ],
)
def test_work_of_a_load_is_stored(how):
    """For each element and kind of material; reactions balance the load, and moments do."""
    if how.get("element") == "assumed":
        how = how | {"element": rf.AssumedStrains(thickness="z0")}
    load = rf.Traction("x1", (0.0, 0.0, 2e4))
    reports = [*rf.static(bar(rf.Fixed("x0"), load, **how), 20)]
    work, energy = energy_is_that_of_the_load(reports, (0, 0, 200.0))
    np.testing.assert_allclose(work, energy, rtol=0.02)
    end = reports[-1]
    np.testing.assert_allclose(end.reactions["x0"], (0, 0, -200.0), atol=1e-6)
    assert end.probes["tip"][2] > 0.3
    moment = np.cross(np.array(TIP) + end.probes["tip"], (0, 0, 200.0))
    assert abs(end.reaction_moments["x0"][1] + moment[1]) < 0.01 * abs(moment[1])


def test_a_rigid_part_is_as_a_stiff_one():
    """Under a force off its centre and a torque, with a spring on it and a pressure around it."""
    effects = [
        rf.Fixed("x0"),
        rf.Traction("z1", (300.0, 0.0, 4e3)),
        rf.Pressure("y1", 2e3),
        rf.Spring("x1", (50.0, 100.0, 20.0)),
    ]
    rigid = last(bar(*effects, rf.Rigid("end"), order=2))
    assert rigid.rigid.R[0, 0, 0] < 0.9  # it has turned by more than 25°
    tips = []
    for E in (1e8, 1e9):
        stiff = {"end": rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0), "rest": SOFT}
        tips.append(last(bar(*effects, material=stiff, order=2)).probes["tip"])
    limit = (10 * tips[1] - tips[0]) / 9
    np.testing.assert_allclose(rigid.probes["tip"], limit, rtol=1e-4, atol=1e-6)
    assert 3 < rigid.iterations < 12


def test_prescribed_displacement_and_rotation():
    """Half a turn of one end, then a pull by a tenth; the torque is that of Saint-Venant."""
    turn = rf.PrescribedRotation(
        "x1", axis=(1, 0, 0), through=(0, 0.05, 0.05), angle=lambda t: 0.2 * t
    )
    twisted = last(bar(rf.Fixed("x0"), turn, n=(20, 2, 2), order=2), 2)
    constant = 0.1406 * 0.1**4 * 1e6 / 2.6
    np.testing.assert_allclose(twisted.reaction_moments["x1"][0], constant * 0.2, rtol=0.05)
    pull = rf.PrescribedMotion("x1", displacement=lambda t: (0.1 * t, 0, 0))
    pulled = last(bar(rf.Fixed("x0"), pull, material=RUBBER), 1)
    np.testing.assert_allclose(pulled.probes["tip"], (0.1, 0, 0), atol=1e-12)
    np.testing.assert_allclose(pulled.work_of_supports, pulled.strain, rtol=0.1)


def test_windows_and_given_factors():
    """A load that ends leaves; one with a factor of its own follows it; breakpoints end steps."""
    ends = rf.Traction("x1", (0.0, 0.0, 500.0), until=0.5)
    steady = rf.Traction("x1", (0.0, 500.0, 0.0), time=rf.Table((0, 0.25), (0, 1)))
    reports = {r.t: r for r in rf.static(bar(rf.Fixed("x0"), ends, steady), [0.4, 1.0])}
    assert sorted(reports) == [0.0, 0.25, 0.4, 0.5, 1.0]
    y, z = (np.array([reports[t].probes["tip"][k] for t in sorted(reports)]) for k in (1, 2))
    assert abs(z[-1]) < 1e-9 < 1e-3 < z[-2]
    np.testing.assert_allclose(y[2], y[1], rtol=0.05)
    np.testing.assert_allclose(z[2] / z[3], 0.8, rtol=0.01)


def test_a_run_starts_in_balance_and_stays_there(tmp_path):
    """With a rigid end and a spring; of a scene of its own, on the same domain."""
    domain = bar().domain
    effects = [rf.Fixed("x0"), rf.Traction("x1", (0, 0, 1e3)), rf.Rigid("end")]
    effects.append(rf.Spring("end", 30.0))
    statics, moves = (rf.Scene(domain, SOFT, effects, probes={"tip": TIP}) for _ in range(2))
    with rf.Recorder(statics, tmp_path / "out", every=1) as recorder:
        for report in rf.static(statics, 3):
            recorder.write(report)
    assert read_history(tmp_path / "out")["t"].size == 4
    tip, ended = report.probes["tip"], report.energy
    first, *_, end = rf.simulate(moves, 1e-3, 5e-3, start=report)
    np.testing.assert_allclose(first.energy, ended, rtol=1e-12)
    np.testing.assert_allclose(end.probes["tip"], tip, atol=1e-10)
    assert end.kinetic < 1e-14 * ended
    with rf.Recorder(moves, tmp_path / "run", every=1) as recorder:
        for moving in rf.simulate(moves, 1e-3, 5e-3, start=report):
            recorder.write(moving)
    led, run = (read_history(tmp_path / name) for name in ("out", "run"))
    for column in ("u_tip_x", "u_tip_z", "strain", "springs"):
        np.testing.assert_allclose(run[column][0], led[column][-1], rtol=1e-9, atol=1e-12)
    with pytest.raises(rf.SceneError, match="with another mesh or order"):
        rf.simulate(bar(order=2), 1e-3, 1e-3, start=report)
    both = bar(rf.Fixed("x0"), rf.Preload([rf.Gravity()]))
    with pytest.raises(rf.SceneError, match="Make both scenes from one domain"):
        rf.simulate(both, 1e-3, 1e-3, start=report)


def test_a_preload_is_the_shortest_use():
    """With a rigid part, which turns; and its initial velocity is that of the scene."""
    load = rf.Traction("x1", (0, 0, 1e4))
    others = [rf.Fixed("x0"), rf.Rigid("end")]
    end = last(bar(*others, load), 3)
    loaded = bar(*others, load, rf.Preload([load], increments=3))
    first, *_, then = rf.simulate(loaded, 1e-3, 5e-3)
    np.testing.assert_allclose(first.probes["tip"], end.probes["tip"], atol=1e-9)
    np.testing.assert_allclose(first.reactions["x0"], end.reactions["x0"], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(then.probes["tip"], end.probes["tip"], atol=1e-9)


GAP, BEARING, WEAK = 1e-4, 1e6, 1e4  # m, N/m³, N/m


def blocks_pressed(load, n=4):
    """A block above another one, of two materials without Poisson's effect, pressed at its top."""
    z = 0.5 + GAP
    lower, upper = ((0, 0, 0), (1, 1, 0.5), (2, 2, 1)), ((0, 0, z), (1, 1, z + 0.3), (n, n, 1))
    domain = boxes(lower, upper)
    between = 0.5 + 0.5 * GAP
    domain = domain.with_cells("low", lambda x: x[2] < between)
    domain = domain.with_cells("high", lambda x: x[2] > between)
    for name, level in (("bottom", 0.0), ("lower", 0.5), ("upper", z), ("top", z + 0.3)):
        at = lambda x, level=level: np.abs(x[2] - level) < 0.1 * GAP  # noqa: E731
        domain = domain.with_facets(name, at)
    low, high = (rf.StVenantKirchhoff(E=E, nu=0.0, rho=1000.0) for E in (1e6, 5e5))
    effects = [
        rf.Fixed("bottom"),
        rf.Fixed("top", "xy"),
        rf.Spring("top", (0.0, 0.0, WEAK)),
        rf.Traction("top", (0.0, 0.0, -load)),
        rf.Contact("upper", against="lower", stiffness=BEARING, title="pair"),
    ]
    probes = {"top": (0.5, 0.5, z + 0.3)}
    return rf.Scene(domain, {"low": low, "high": high}, effects, probes=probes)


@pytest.mark.parametrize("n", [2, 4])
def test_surfaces_press_each_other(n):
    """Force, mean shortening and energy of two blocks; the spring bears its part.

    Forces of nodes act at points, so that the pressure is even but for some per cent.
    """
    load = 100.0
    found = last(blocks_pressed(load, n), 2)
    force = found.touches["pair"].force
    np.testing.assert_allclose(found.reactions["bottom"], force, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(force[:2], 0.0, atol=1e-5 * load)
    shorter = (load - force[2]) / WEAK - GAP
    np.testing.assert_allclose(shorter, force[2] * (1 / BEARING + 0.5 / 1e6 + 0.3 / 5e5), rtol=0.01)
    np.testing.assert_allclose(found.contact, 0.5 * force[2] ** 2 / BEARING, rtol=0.01)
    np.testing.assert_allclose(-found.probes["top"][2], GAP + shorter, rtol=0.02)


def test_a_path_ends_at_its_limit():
    """A column of one cell that is pushed through: Green strains soften as it is compressed."""
    column = rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1))
    material = rf.StVenantKirchhoff(E=1e6, nu=0.0, rho=1.0)
    guides = [rf.Fixed("z0"), rf.Fixed("z1", "xy")]
    load = rf.Traction("z1", (0.0, 0.0, -4e5))
    exact = 1e6 / (3 * np.sqrt(3))  # S λ = E/2 (λ² - 1) λ is least at λ = 1/√3
    reached = 0.0
    path = rf.static(rf.Scene(column, material, [*guides, load]), 10)
    while True:
        try:
            reached = 4e5 * next(path).t
        except rf.StepError as error:
            found = str(error)
            break
    assert re.search("static: no equilibrium .* limit load, where", found)
    assert exact * 0.998 < reached < exact * (1 + 1e-9)


@pytest.mark.parametrize(("joint", "count"), [("Revolute", 1), ("Revolute", 3), ("Spherical", 2)])
def test_a_chain_falls_until_it_hangs(joint, count):
    """Links that begin level are held by their weight alone, and then swing as links do."""
    how = {"axis": (0, 1, 0)} if joint == "Revolute" else {}
    level = chain(
        count, lambda a, b, at: getattr(rf, joint)(a, b, at, **how), along=(1.0, 0.0, 0.0)
    )
    *_, hangs = rf.static(level, 2)
    for link in hangs.bodies:
        k = int(link.name.split()[1])
        np.testing.assert_allclose(link.centre, (0, 0, -k - 0.5), atol=1e-8)
    swings = rf.modes(level, 2 * count, about=hangs).frequencies
    np.testing.assert_allclose(swings[:: 1 if how else 2], swinging(count), rtol=1e-7)


def test_a_gap_closes_at_the_first_load():
    """Nothing but a floor 1 mm below holds a block, without cuts of load steps."""
    block = rf.box((0, 0, 1e-3), (1, 1, 1.001), (2, 2, 2))
    floor = rf.Contact(
        "z0", against=rf.Plane((0, 0, 0), (0, 0, 1)), friction=0.3, creep=1e-4, title="floor"
    )
    reports = list(rf.static(rf.Scene(block, SOFT, [floor, rf.Gravity()]), 4))
    weight = SOFT.rho * 9.81
    for k, report in enumerate(reports[1:], 1):
        assert (report.t, report.cuts) == (k / 4, 0)
        np.testing.assert_allclose(report.touches["floor"].force[2], k / 4 * weight, rtol=1e-8)


def test_what_is_said():
    """A block that slides freely on a floor has no place; misspelt options have no effect."""
    floor = rf.Plane((0, 0, 0), (0, 0, 1))
    for friction, count in ((None, 1), (0.3, 0)):
        how = {} if friction is None else {"friction": friction, "creep": 1e-3}
        rests = bar(rf.Contact("z0", against=floor, **how), rf.Gravity())
        with heard() as found:
            list(rf.static(rests, 1))
        assert ["contacts without friction do not hold" in text for text in found] == [True] * count
    held = bar(rf.Fixed("x0"), rf.Contact("z0", against=floor), rf.Gravity())
    with pytest.warns(rf.RigidfxWarning, match="no solver at work has asked for 'ksp_typ'"):
        last(held, 1, petsc_options={"ksp_typ": "cg"})


@pytest.mark.parametrize("rigid", [[], [rf.Rigid()]])
def test_friction_alone_holds_a_block_on_a_slope(rigid):
    """Up to the angle whose tangent is μ, where it creeps by ε tan φ/√(μ² - tan² φ); not beyond.

    Beyond, each load step fails, runs away, and must not be taken for one at its rounding.
    """
    block = rf.box((0, 0, 0), (1, 1, 0.5), (2, 2, 1))
    floor = rf.Plane((0, 0, 0), (0, 0, 1))
    mu, creep = 0.4, 1e-4
    grip = rf.Contact("z0", against=floor, friction=mu, creep=creep, title="floor")

    def stands(degrees):
        slope = np.radians(degrees)
        weight = rf.Gravity((9.81 * np.sin(slope), 0.0, -9.81 * np.cos(slope)))
        scene = rf.Scene(block, SOFT, [grip, weight, *rigid], probes={"foot": (0.5, 0.5, 0.0)})
        return last(scene, 2), np.tan(slope)

    found, tan = stands(21.7)
    force = found.touches["floor"].force
    np.testing.assert_allclose(-force[0] / force[2], tan, rtol=1e-9)
    if rigid:
        crept = creep * tan / np.sqrt(mu**2 - tan**2)
        assert found.probes["foot"][0] == pytest.approx(crept, rel=0.02)
    else:
        with pytest.raises(rf.StepError, match="slides off where friction does not bear its loads"):
            stands(22.0)


def on_ranks():
    """Tips and reactions with a rigid end, pressure, a floor and friction; a pair of blocks."""
    floor = rf.Plane((0, 0, -0.05), (0, 0, 1))
    scene = bar(
        rf.Fixed("x0"),
        rf.Rigid("end"),
        rf.Pressure("z1", 3e2),
        rf.Contact("z0", against=floor, friction=0.3, creep=1e-4, title="floor"),
    )
    found = last(scene, 3)
    force = found.touches["floor"].force
    pair = last(blocks_pressed(100.0), 1)
    both = pair.probes["top"][2], pair.touches["pair"].pressing
    return [*found.probes["tip"], *found.reactions["x0"], *force, found.energy, *both]


@pytest.mark.parallel
def test_ranks_find_the_same():
    mine = np.array(on_ranks())
    assert mine[8] > 1.0  # the floor bears some
    np.testing.assert_allclose(mpirun(__file__, 3, 300), mine, rtol=1e-7, atol=1e-9)


if __name__ == "__main__":
    tell(on_ranks())


def test_a_rigid_part_takes_what_a_beam_lacks_by_it():
    """A beam of length L whose root is rigid over a bends by (1 - a/L)³ of what it would."""
    root = rf.box((0, 0, 0), (1, 0.1, 0.1), (20, 1, 1)).with_cells("root", lambda x: x[0] < 0.2001)
    push = rf.Traction("x1", (0, 0, 1.0))
    effects = rf.Fixed("x0"), push, rf.Rigid("root"), rf.Preload([rf.Gravity((0, 0, -1.0))])
    scene = rf.Scene(root, SOFT, effects, order=2, probes={"tip": TIP})
    found = rf.compliance(scene)
    assert found.taken["tip"] == pytest.approx(1 - 0.8**3, rel=0.02)
    assert "tip: rigid parts change its displacement by 4" in str(found)
    alone = rf.Scene(root, SOFT, [rf.Fixed("x0"), push], order=2, probes={"tip": TIP})
    np.testing.assert_allclose(found.flexible["tip"], last(alone, 1).probes["tip"], rtol=1e-9)


@pytest.mark.parametrize("masses", [[], [(1.2, 0, 0), (1.0, 0.3, 0)]])
def test_a_rigid_face_takes_what_a_beam_lacks_by_it(masses):
    """Nodes of the last tenth of a beam that is pushed at their mean: rigid, or free to bend."""
    beam = rf.box((0, 0, 0), (1, 0.1, 0.1), (10, 1, 1)).with_facets("end", lambda x: x[0] > 0.8999)

    def scene_with(face):
        loads = [rf.Resultant(face, force=(0, 0, 1.0)), rf.Gravity((0, 0, 1e-2))]
        loads += [rf.PointMass(face, 1.0, at=at) for at in masses]
        return rf.Scene(beam, SOFT, [rf.Fixed("x0"), *loads], order=2, probes={"tip": TIP})

    scene, soft = scene_with(rf.RigidFace("end")), scene_with(rf.MeanFace("end"))
    found = rf.compliance(scene)
    for displacements, of in ((found.rigid, scene), (found.flexible, soft)):
        np.testing.assert_allclose(displacements["tip"], last(of, 1).probes["tip"], rtol=1e-9)
    assert 1e-4 < found.taken["tip"] < 0.05


@pytest.mark.parametrize(
    ("effects", "probes", "lacking"),
    [
        ((), {"tip": TIP}, "no Rigid or Reduced part"),
        ((rf.Rigid("end"),), None, "no probe"),
        ((rf.Rigid("end"),), {"tip": TIP}, r"no load moves a probe \(tip\)"),
    ],
)
def test_compliance_asks_for_a_rigid_part_a_probe_and_a_load(effects, probes, lacking):
    domain = rf.box((0, 0, 0), (1, 0.1, 0.1), (10, 1, 1))
    domain = domain.with_cells("end", lambda x: x[0] > 0.8 - 1e-9)
    scene = rf.Scene(domain, SOFT, (rf.Fixed("x0"), *effects), probes=probes)
    with pytest.raises(rf.SceneError, match=lacking):
        rf.compliance(scene)
