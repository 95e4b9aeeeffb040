"""Parts that deform by a few shapes: mechanics, neighbours, supports, contacts, ranks, restarts."""

import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from histories import gone_on, imbalance, tips
from parallel import check_the_same, report

import rigidfx as rf
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import StaticStep, Step
from rigidfx.mechanics.rigid_body import Body, BodyMotion, RigidBody
from rigidfx.mechanics.rotation import cayley
from rigidfx.mechanics.shaped_step import increments_of
from rigidfx.mechanics.shapes import Shapes

SOFT = rf.StVenantKirchhoff(E=1e8, nu=0.3, rho=1000.0)
DT, T_END = 2e-3, 0.06
THROWN = rf.InitialVelocity(linear=(0.1, 0, 0), angular=(0, 3.0, 1.0))
EXACT = 1e-12


def pushed(t):
    return np.sin(np.pi * t / 0.02) ** 2 if t < 0.02 else 0.0


PUSH = rf.Traction("x1", (0, 0, 300.0), time=pushed)


def bar(*effects, n=(12, 2, 2), **more):
    domain = rf.box((0, 0, 0), (1.0, 0.1, 0.1), n)
    domain = domain.with_cells("half", lambda x: x[0] < 0.5 + 1e-9)
    domain = domain.with_cells("end", lambda x: x[0] > 0.75 - 1e-9)
    domain = domain.with_cells("low", lambda x: x[0] < 0.25 + 1e-9)
    domain = domain.with_cells("next", lambda x: (x[0] > 0.5 - 1e-9) & (x[0] < 0.75 + 1e-9))
    domain = domain.with_cells("rest", lambda x: x[0] < 0.75 + 1e-9)
    return rf.Scene(domain, SOFT, effects, **{"probes": {"tip": (1.0, 0.05, 0.05)}} | more)


def run(scene, t_end=T_END, **more):
    return list(rf.simulate(scene, dt=DT, t_end=t_end, **more))


# The mechanics ------------------------------------------------------------------------------------


def shaped(rng, m, held=False):
    """A body of thirty masses with m shapes, and the masses."""
    X, mass = rng.standard_normal((30, 3)), rng.random(30) + 0.5
    centre = mass @ X / mass.sum()
    xi, phi = X - centre, 0.3 * rng.standard_normal((30, m, 3))
    phi[:4] *= not held
    drift = np.einsum("n,nka->ka", mass, phi) / mass.sum()
    fields = np.concatenate([xi[:, None], phi - drift], axis=1)
    moments = np.einsum("n,nka,nlb->klab", mass, fields, fields)
    inertia = np.trace(moments[0, 0]) * np.eye(3) - moments[0, 0]
    moments[0, 0] = 0.0
    A, nodes = rng.standard_normal((m, m)), np.arange(30, dtype=np.int32)
    known = nodes, fields[:, 1:], moments, 50 * A @ A.T + np.eye(m)
    shapes = Shapes(*known, rng.standard_normal(m), drift if held else None, given=2 * held)
    data = RigidBody("b", nodes, nodes, xi, 0 * xi, mass.sum(), inertia, centre)
    return replace(data, shapes=shapes) if m else data


@pytest.fixture
def bodies():
    """Bodies with three, no and five shapes in any motion, the last one held by two supports."""
    rng, each = np.random.default_rng(1), []
    for m, held in ((3, False), (0, False), (5, True)):
        data = shaped(rng, m, held)
        R = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        motion = rng.standard_normal((2, 3)), 0.2 * rng.standard_normal((2, m))
        each.append(
            Body(data, BodyMotion(data.origin, R * np.linalg.det(R), *motion[0], *motion[1]))
        )
    return Bodies.of_each(each)


def trial(bodies, kind=Step):
    """A step, unknowns, and moments of forces."""
    rng, of = np.random.default_rng(2), bodies.of
    given = np.zeros((3, 11))
    given[2, :8] = 0.1, 0.2, -0.1, 0.3, -0.2, 0.25, 0.1, -0.15
    y = np.where(of.known, 0.3 * rng.standard_normal(of.known.shape), 0.0)
    moments = np.zeros_like(bodies.pose)
    for k, data in enumerate(of.records):
        a = data.coordinates()
        moments[k, : a.shape[1]] = a.T @ rng.standard_normal((len(a), 3))
    damping = np.zeros((3, 5, 5))
    damping[0, :3, :3] = 7.0 * np.eye(3)
    step = Step(bodies, 0.05, damping, given) if kind is Step else StaticStep(bodies, given)
    return step, y, moments, given


def test_nodes_move_by_the_rows_of_the_prolongation(bodies):
    step, y, _, given = trial(bodies)
    found = increments_of(step, y)
    for k, data in enumerate(bodies.of.records):
        a = data.coordinates()
        n = a.shape[1]
        moved = a @ (found.end.pose[k, :n] - bodies.pose[k, :n])
        assert np.abs(moved - a @ found.displacement[k, :n]).max() < EXACT
        if k < 2:  # that of the body that is held has given parts, too
            rows = found.L[k].reshape(-1, 3, y.shape[1])[:n]
            assert np.abs(moved - np.einsum("nk,kau,u->na", a, rows, y[k])).max() < EXACT
    held = bodies.of.records[2].coordinates()[:4]
    before, after = held @ bodies.pose[2], held @ found.end.pose[2]
    turn = cayley(given[2, 3:6])
    assert np.abs(after - after[0] - (before - before[0]) @ turn.T).max() < EXACT


@pytest.mark.parametrize("kind", [Step, StaticStep])
def test_the_derivative_of_the_residual_is_complete(bodies, kind):
    step, y, moments, _ = trial(bodies, kind)

    def residual(y):
        return increments_of(step, y).balance(moments, np.zeros((3, 3)))

    blocks = increments_of(step, y).blocks(moments)
    for k, known in enumerate(bodies.of.known):
        own, J = np.flatnonzero(known), []
        for j in own:
            h = np.zeros_like(y)
            h[k, j] = 1e-6
            J.append((residual(y + h) - residual(y - h))[k, own] / 2e-6)
        wanted = np.transpose(J)
        assert np.abs(blocks[k][np.ix_(own, own)] - wanted).max() < 1e-8 * np.abs(wanted).max()


def test_velocities_and_momenta_are_those_of_the_nodes(bodies):
    for k, body in enumerate(bodies):
        n = body.data.coordinates().shape[1]
        assert np.allclose(body.velocities, body.data.coordinates() @ bodies.pose_rate[k, :n])
        own = bodies.rates[k]
        assert 0.5 * own @ bodies.mass_blocks[k] @ own == pytest.approx(bodies.kinetic_of_each[k])


# Runs ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_a_tumbling_body_keeps_energy_and_momenta(mass):
    effects = rf.Reduced(shapes=12), rf.InitialVelocity(angular=(9.0, 4.0, 2.0))
    reports = run(bar(*effects, mass=mass), t_end=0.4)
    assert reports[-1].unknowns == 18
    last, first = reports[-1], reports[0]
    assert np.ptp([r.energy for r in reports]) < EXACT * first.energy
    spin = np.array([r.angular_momentum for r in reports])
    assert np.ptp(spin, axis=0).max() < EXACT * np.abs(spin).max()
    assert np.abs(last.state.bodies.q).max() > 1e-6  # the spin stretches it


def test_a_step_is_of_second_order():
    def place(dt):
        scene = bar(rf.Reduced(shapes=1), PUSH, THROWN)
        return list(rf.simulate(scene, dt=dt, t_end=0.02))[-1].probes["tip"]

    exact = place(1e-4)
    coarse, fine = (np.linalg.norm(place(dt) - exact) for dt in (1e-3, 5e-4))
    assert 1.8 < np.log2(coarse / fine) < 2.2


CASES = {
    "free": ([rf.Reduced(), PUSH, THROWN], {}, 1e-5),
    "half": ([rf.Reduced("half"), PUSH, THROWN], {}, 1e-5),
    "consistent": ([rf.Reduced("half"), PUSH, THROWN], {"mass": "consistent"}, 1e-5),
    "second order": ([rf.Reduced("half"), PUSH, THROWN], {"order": 2, "n": (6, 1, 1)}, 1e-5),
    "weight": ([rf.Reduced("end"), PUSH, rf.Fixed("x0"), rf.Gravity((0, 0, -1.0))], {}, 1e-5),
    "spring": ([rf.Reduced("half"), PUSH, rf.Spring("x0", 1e6)], {"element": "enhanced"}, 2e-3),
    "face": ([rf.Reduced("half"), rf.Resultant(rf.MeanFace("x0"), (0, 0, 1.0))], {}, 1e-4),
    "far face": ([rf.Reduced("end"), rf.Resultant(rf.MeanFace("x0"), (0, 0, 1.0))], {}, 1e-4),
    "damped": ([rf.Reduced("half"), PUSH, rf.StiffnessDamping(0.1, 30.0)], {}, 1e-5),
    "numerical": ([rf.Reduced("half"), PUSH, rf.NumericalDamping(0.1)], {}, 1e-5),
    "drag": ([rf.Reduced("half"), PUSH, rf.MassDamping(20.0)], {}, 1e-4),
    "pressed": ([rf.Reduced("half"), rf.Pressure("z1", 3e4, time=pushed), THROWN], {}, 1e-4),
    "held": ([rf.Reduced("half"), PUSH, rf.Fixed("x0")], {"element": "enhanced"}, 1e-3),
    "turned": (
        [
            rf.Reduced("half"),
            PUSH,
            rf.PrescribedRotation(
                "x0", axis=(0, 0, 1), angle=lambda t: 2 * t * t, through=(0, 0.05, 0.05)
            ),
        ],
        {},
        5e-3,
    ),
    "moved": (
        [
            rf.Reduced("half"),
            rf.PrescribedMotion("x0", displacement=lambda t: (0, 2e-3 * pushed(t), 0)),
        ],
        {},
        2e-2,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_it_moves_as_its_flexible_twin(case):
    effects, how, error = CASES[case]
    own, twin = run(bar(*effects, **how)), run(bar(*effects[1:], **how))
    assert own[-1].unknowns < 0.8 * twin[-1].unknowns
    assert np.abs(tips(own) - tips(twin)).max() < error * np.abs(tips(twin)).max()
    assert imbalance(own) < 1e-10
    for kind, energy in twin[-1].dissipated.items():
        assert own[-1].dissipated[kind] == pytest.approx(energy, rel=0.05)


@pytest.mark.parametrize("damping", [rf.StiffnessDamping(0.1, 30e6), rf.KelvinVoigt(0.1)])
def test_damping_does_not_depend_on_the_units(damping):
    """Micrometres and microseconds: 3 and 11 % of the energy that damping takes were rounding."""
    size, taken = 1e-6, []
    domain = rf.box((0, 0, 0), (size, 0.05 * size, 0.02 * size), (12, 2, 1))
    push = rf.Traction("x1", (0, 0, 100.0), time=lambda t: np.sin(np.pi * t / 2e-6) ** 2)
    effects = [rf.Fixed("x0"), push, damping]
    for parts in ([], [rf.Reduced()]):
        scene = rf.Scene(domain, SOFT, [*effects, *parts], element="enhanced")
        _, *reports = rf.simulate(scene, 5e-8, 2e-6)
        taken.append(sum(report.dissipated[damping.kind] for report in reports))
    assert taken[1] == pytest.approx(taken[0], rel=1e-3)


SWINGING = rf.InitialVelocity(function=lambda x: np.stack([0 * x[0], 0 * x[0], 0.1 * x[0] ** 2]))
STARTS = {
    "swings": ([SWINGING], {}),
    "held": ([SWINGING, rf.Fixed("x0")], {}),
    "consistent": ([SWINGING, rf.Fixed("x0")], {"mass": "consistent"}),
    "goes": ([rf.PrescribedMotion("x0", displacement=lambda t: (0, 0, 0.08 * t))], {}),
}


@pytest.mark.filterwarnings("ignore:At t = 0 s 'x0' acts with a jolt:rigidfx.RigidfxWarning")
@pytest.mark.filterwarnings("ignore:Reduced 'all cells'. at t:rigidfx.RigidfxWarning")  # 0.4 %
@pytest.mark.parametrize("where", ["half", None])
@pytest.mark.parametrize("case", STARTS)
def test_shapes_take_velocities_of_nodes_over(case, where):
    """Those of the start, and those that a support leaves to nodes when it starts to move."""
    effects, how = STARTS[case]
    own, twin = run(bar(rf.Reduced(where), *effects, **how)), run(bar(*effects, **how))
    if case != "goes":  # a jump from one layer of nodes to the next is none of shapes
        assert own[0].kinetic == pytest.approx(twin[0].kinetic, rel=5e-3)
    assert np.abs(tips(own) - tips(twin)).max() < 0.02 * np.abs(tips(twin)).max()
    assert imbalance(own) < 1e-10


def test_reactions_of_a_frame_that_is_held_are_those_of_the_twin():
    effects = [rf.Fixed("x0"), rf.Gravity((0, 0, -1.0)), rf.StiffnessDamping(0.5, 10.0)]
    own, twin = (run(bar(*e, *effects), t_end=0.4)[-1] for e in ([rf.Reduced()], []))
    weight = 1000.0 * 0.01
    assert own.reactions["x0"][2] == pytest.approx(weight, rel=0.02)
    assert np.abs(own.reactions["x0"] - twin.reactions["x0"]).max() < 0.01 * weight
    moments = own.reaction_moments["x0"], twin.reaction_moments["x0"]
    assert np.abs(moments[0] - moments[1]).max() < 0.01 * weight


OVER = (0.9, 0.025, 0.0702)
PRESSES = {0.06: partial(rf.Sphere, OVER, 0.05), 0.1: partial(rf.Cylinder, OVER, 0.05, (0, 1, 0))}


@pytest.mark.parametrize("way", PRESSES)
def test_what_presses_may_bend_a_part_far(way):
    """Cells that left had 126 J by the bend, and no step converged; warnings began at 1.2 %."""
    domain = rf.box((0, 0, 0), (1, 0.05, 0.02), (12, 2, 1))
    plastic = rf.StVenantKirchhoff(E=2e9, nu=0.3, rho=2000.0)
    obstacle = PRESSES[way](path=lambda t: (0, 0, -way * (t / 0.2) ** 2))
    contact = rf.Contact("z1", against=obstacle, stiffness=1e8)
    effects, probes = [rf.Fixed("x0"), contact, rf.StiffnessDamping(0.05, 5.0)], {"tip": (1, 0, 0)}
    x = []
    for parts in ([], [rf.Reduced()]):
        scene = rf.Scene(domain, plastic, [*effects, *parts], element="enhanced", probes=probes)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            *_, last = rf.simulate(scene, 2e-3, 0.2)
        x.append(last.probes["tip"])
    told = next(str(w.message) for w in caught if "too far for its shapes" in str(w.message))
    assert float(told.split("ν = ")[1].split("%")[0]) < 1.0
    assert np.abs(x[1] - x[0]).max() < 0.02 * np.abs(x[0]).max()


def fall(*effects, fast=0.5, path=None, friction=None):
    """A block that falls on a corner, or rests; with friction it slides."""
    block = rf.box((0, 0, 0), (0.1, 0.1, 0.1), (3, 3, 3))
    plane = rf.Plane((0, 0, -5e-4), (0.3, 0.2, 1.0), path=path)
    rubs = {"friction": friction, "creep": 1e-3} if friction else {}
    floor = rf.Contact("skin", against=plane, stiffness=1e11, title="floor", **rubs)
    block = block.with_facets("skin", lambda x: x[2] < 1e-9)
    block = block.with_cells("above", lambda x: x[2] > 0.1 / 3 - 1e-9)
    thrown = rf.InitialVelocity(linear=(0.3 if friction else 0, 0, -fast))
    return rf.Scene(block, SOFT, [floor, thrown, *effects], probes={"tip": (0.1, 0.1, 0.1)})


def hit(scene):
    with warnings.catch_warnings():  # of blows that a few cells do not resolve
        warnings.simplefilter("ignore", rf.RigidfxWarning)
        return list(rf.simulate(scene, dt=1e-4, t_end=6e-3))


def test_a_node_that_presses_gives_a_part_its_shapes():
    own, twin, rigid = (hit(fall(*e)) for e in ([rf.Reduced()], [], [rf.Rigid()]))
    peak, wanted, stiff = (
        max(r.touches["floor"].pressing for r in of if r.step) for of in (own, twin, rigid)
    )
    assert own[0].unknowns == 6
    assert 6 < own[-1].unknowns <= 42
    assert peak == pytest.approx(wanted, rel=0.05)
    assert abs(stiff / wanted - 1) > 0.2
    assert np.ptp([r.energy for r in own]) < 1e-10 * own[0].energy
    assert own[-1].linear_momentum[2] == pytest.approx(twin[-1].linear_momentum[2], rel=0.02)


def test_nodes_that_press_beside_a_part_give_it_shapes():
    """A layer of flexible cells bears the contact, and the part follows behind it."""
    own, twin, rigid = (hit(fall(*e)) for e in ([rf.Reduced("above")], [], [rf.Rigid("above")]))
    peak, wanted, stiff = (
        max(r.touches["floor"].pressing for r in of if r.step) for of in (own, twin, rigid)
    )
    assert own[0].bodies[0].shapes == 0 < own[-1].bodies[0].shapes
    assert peak == pytest.approx(wanted, rel=0.005)
    assert abs(stiff / wanted - 1) > 0.05
    assert np.ptp([r.energy for r in own]) < 1e-10 * own[0].energy
    assert own[-1].linear_momentum[2] == pytest.approx(twin[-1].linear_momentum[2], rel=0.005)


def struck(*effects):
    """A block of plastic that falls on a corner, which yields by a tenth of a cell."""
    block = rf.box((0, 0, 0), (0.1, 0.1, 0.1), (4, 4, 4)).with_facets("skin", lambda x: x[2] < 1e-9)
    plane = rf.Plane((0, 0, -5e-4), (0.3, 0.2, 1.0))
    floor = rf.Contact("skin", against=plane, stiffness=1e11, title="floor")
    plastic = rf.NeoHooke(E=1e8, nu=0.3, rho=1000.0)
    thrown, tip = rf.InitialVelocity(linear=(0, 0, -2.0)), {"tip": (0.1, 0.1, 0.1)}
    return rf.Scene(block, plastic, [floor, thrown, *effects], element="enhanced", probes=tip)


def test_cells_that_a_contact_presses_too_far_leave_a_part():
    """With them the peak errs by 1.2 %."""
    own, twin = hit(struck(rf.Reduced())), hit(struck())
    left = [r.unknowns - 6 - r.bodies[0].shapes for r in own]
    assert left[0] == 0 < left[-1] < 0.1 * twin[-1].unknowns
    assert all(np.diff(left) >= 0)
    peaks = [max(r.touches["floor"].pressing for r in of if r.step) for of in (own, twin)]
    assert peaks[0] == pytest.approx(peaks[1], rel=2e-3)
    momenta = [of[-1].linear_momentum[2] for of in (own, twin)]
    assert momenta[0] == pytest.approx(momenta[1], rel=2e-3)
    assert np.ptp([r.energy for r in own]) < 1e-10 * own[0].energy


def test_a_part_that_nothing_loads_yet_stays_held():
    """A wall comes up under a block that hangs: its first shapes are there before it does."""

    def pressed(*effects):
        return hit(fall(rf.Fixed("z1"), *effects, fast=0.0, path=lambda t: (0, 0, 10 * t * t)))

    own, twin = pressed(rf.Reduced()), pressed()
    assert own[0].unknowns > 0
    peaks = [max(r.touches["floor"].pressing for r in of if r.step) for of in (own, twin)]
    assert peaks[0] == pytest.approx(peaks[1], rel=0.05)


@pytest.mark.filterwarnings("ignore::rigidfx.RigidfxWarning")
def test_a_restart_goes_on_with_the_same_digits(tmp_path):
    """It is cut before the block touches, so that its shapes grow afterwards."""
    whole = hit(fall(rf.Reduced(), friction=0.4))
    make = partial(fall, rf.Reduced(), friction=0.4)
    more = gone_on(make, 1e-4, 6e-3, rf.Checkpoint(tmp_path, steps=1), 4)
    assert more[0].unknowns == 6
    assert more[-1].unknowns == whole[-1].unknowns > 6
    assert more[-1].probes["tip"] == pytest.approx(whole[-1].probes["tip"], rel=EXACT)


@pytest.mark.filterwarnings("ignore::rigidfx.RigidfxWarning")
def test_a_restart_knows_which_cells_leave_a_part(tmp_path):
    """Each checkpoint is kept; those before and after cells leave lead to the same end."""
    whole = hit(struck(rf.Reduced()))
    unknowns = [r.unknowns - r.bodies[0].shapes for r in whole]
    first = int(np.flatnonzero(np.diff(unknowns))[0])  # the last report before cells have left
    for count in (first, first + 1):
        left = rf.Checkpoint(tmp_path / str(count), steps=1)
        more = gone_on(partial(struck, rf.Reduced()), 1e-4, 6e-3, left, count + 2)
        assert more[-1].unknowns == whole[-1].unknowns
        assert more[-1].probes["tip"] == pytest.approx(whole[-1].probes["tip"], rel=EXACT)


@pytest.mark.filterwarnings("ignore::rigidfx.RigidfxWarning")
def test_cells_beside_it_freeze_and_wake():
    push = rf.Traction("x1", (0, 0, 300.0), time=pushed)
    late = rf.Traction("x1", (0, 0, 300.0), since=0.2, until=0.22)
    effects = rf.Reduced("half"), push, late, rf.StiffnessDamping(0.3, 100.0)
    criterion = rf.StrainRate(0.02, 0.02, wake="all", min_cells=4)
    reports = run(bar(*effects), t_end=0.24, rigidify=criterion)
    kinds = [event.kind for r in reports for event in r.events]
    assert kinds[0] == "freeze"
    assert "release" in kinds
    names = {body.name for r in reports for body in r.bodies}
    assert "half" in names
    assert len(names) > 1
    for r in reports:
        for event in r.events:
            assert event.linear_momentum_error < EXACT
            assert event.angular_momentum_error < EXACT


def test_sets_that_share_nodes_are_one_body():
    reports = run(bar(rf.Reduced("half"), rf.Reduced("next"), PUSH))
    assert [body.name for body in reports[-1].bodies] == ["half + next"]


@pytest.mark.parametrize("held", [None, "x0", "x1"])
def test_rigid_parts_stay_rigid_in_it(held):
    """Reduced on both sides of a hub, or on one where a support holds the hub."""
    support = [] if held is None else [rf.Fixed(held)]
    hub = "end" if held == "x1" else "next"
    sets = sorted({"half", "next", "end"} - {hub})
    push = rf.Traction("x1" if held == "x0" else "x0", (0, 0, 300.0), time=pushed)
    twin, reports = (
        run(bar(rf.Rigid(hub), *parts, *support, push))
        for parts in ((), [rf.Reduced(name) for name in sets])
    )
    assert [body.name for body in reports[-1].bodies] == [" + ".join([*sets, hub])]
    for last in (twin[-1], reports[-1]):
        last.state.rebuild()
    u, expected = (r[-1].state.u.x.array for r in (reports, twin))
    assert np.abs(u - expected).max() < 1e-3 * np.abs(expected).max()
    assert imbalance(reports) < EXACT


def _found():
    """What is the same on any number of ranks."""
    found = [tips(run(bar(rf.Reduced("half"), PUSH, rf.Fixed("x0"))))[-1]]
    found.append(tips(run(bar(rf.Reduced("half"), PUSH, THROWN, mass="consistent")))[-1])
    found.append(hit(fall(rf.Reduced(), friction=0.4))[-1].probes["tip"])
    found.append(hit(struck(rf.Reduced()))[-1].probes["tip"])
    return np.array(found).ravel().tolist()


@pytest.mark.parallel
def test_it_is_the_same_on_several_ranks():
    check_the_same(__file__, 3, _found())


if __name__ == "__main__":
    found = _found()
    report(found)
