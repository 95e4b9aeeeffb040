"""Places that are shown contain how bending shortens bodies with shapes."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from histories import gone_on
from mpi4py import MPI
from parallel import report, run

import rigidfx as rf

SOFT = rf.StVenantKirchhoff(E=1e8, nu=0.3, rho=1000.0)
DT, T_END = 5e-3, 0.2
AT = {"mid": (1.0, 0.1, 0.1), "tip": (2.0, 0.1, 0.1)}


def bar(force, *effects, probes=("mid", "tip"), held=True, rises=1):
    """A bar of 2 m, whose tip a force bends; beside supports nothing is said of it."""
    domain = rf.box((0, 0, 0), (2.0, 0.2, 0.2), (20, 2, 2))
    domain = domain.with_cells("beyond", lambda x: x[0] > 0.5 - 1e-9)
    load = rf.Traction("x1", (0, 0, force), time=lambda t: np.sin(20 * t) ** rises)
    spin = rf.InitialVelocity(angular=(0, 0, 3.0))
    effects = [load, rf.Fixed("x0") if held else spin, *effects]
    return rf.Scene(domain, SOFT, effects, probes={k: AT[k] for k in probes}, element="enhanced")


def followed(scene, t_end=T_END, **how):
    """Displacements and velocities of probes by steps, (steps, probes, 3) each, and the end."""
    u, v, last = [], [], None
    for last in rf.simulate(scene, DT, t_end, progress=False, **how):
        u.append(list(last.probes.values()))
        v.append(list(last.velocities.values()))
    fields = [f.x.array.reshape(-1, 3).copy() for f in last.shown()[:2]]
    return np.array(u), np.array(v), last, fields


CASES = {
    "held": ((rf.Reduced(),), True, 3e-3),
    "beside flexible cells": ((rf.Reduced("beyond"),), True, 2e-3),
    "free": ((rf.Reduced(),), False, 3e-3),
}


@pytest.mark.filterwarnings("ignore:Reduced 'all cells'. at t:rigidfx.RigidfxWarning")  # it spins
@pytest.mark.parametrize("case", CASES)
def test_probes_and_fields_are_where_those_of_the_flexible_twin_are(case):
    """Bent by 8 % of its length, the held bar is 4 % of the deflection too long without it."""
    effects, held, allowed = CASES[case]
    u, v, last, fields = followed(bar(6e3, *effects, held=held))
    twin_u, twin_v, _, twin = followed(bar(6e3, held=held))
    assert np.abs(u - twin_u).max() < allowed * np.abs(twin_u).max()
    assert np.abs(v - twin_v).max() < allowed * np.abs(twin_v).max()
    for own, other in zip(fields, twin, strict=True):
        assert np.abs(own - other).max() < 2 * allowed * np.abs(other).max()
    for shown, field in ((u[-1], fields[0]), (v[-1], fields[1])):
        for value, at in zip(shown, AT.values(), strict=True):
            (node,) = np.flatnonzero(np.linalg.norm(last.state.X - at, axis=1) < 1e-9)
            assert field[node] == pytest.approx(value, abs=1e-6 * np.abs(shown).max())


def test_it_is_shown_of_what_first_bends_by_rounding():
    """It was never looked at again."""
    u, v, *_ = followed(bar(6e3, rf.Reduced(), rises=8), 0.1)
    twin, rates, *_ = followed(bar(6e3, rises=8), 0.1)
    assert np.abs(u - twin).max() < 3e-3 * np.abs(twin).max()
    assert np.abs(v - rates).max() < 3e-3 * np.abs(rates).max()


def test_equilibria_contain_it():
    load = rf.Traction("x1", (0, 0, 2e3))

    def tip(*effects):
        domain = rf.box((0, 0, 0), (2.0, 0.2, 0.2), (20, 2, 2))
        known = {"probes": {"tip": (2.0, 0.1, 0.1)}, "element": "enhanced"}
        return list(rf.static(rf.Scene(domain, SOFT, [rf.Fixed("x0"), load, *effects], **known)))[
            -1
        ].probes["tip"]

    own, twin = tip(rf.Reduced()), tip()
    assert twin[0] < -4e-3 * twin[2]
    assert own == pytest.approx(twin, abs=1e-4 * twin[2])


@pytest.mark.parametrize(
    ("pull", "side", "shapes", "allowed"),
    [(1e7, 1e4, 3, 0.06), (1e7, 1e4, None, 2e-3), (-1.2e5, 300, None, 2e-3)],
)
def test_pulls_hold_it_and_bend_a_part_otherwise(pull, side, shapes, allowed):
    """It had been 50 % of the bend; a column at 0.73 of its buckling load erred by 3 %."""
    domain = rf.box((0, 0, 0), (1.0, 0.05, 0.02), (12, 2, 1))
    known = {"probes": {"tip": (1.0, 0.05, 0.02)}, "element": "enhanced"}
    soft = rf.StVenantKirchhoff(E=2e9, nu=0.3, rho=1000.0)
    effects = rf.Fixed("x0"), rf.Traction("x1", (pull, 0, side))
    own, twin = (
        [*rf.static(rf.Scene(domain, soft, [*effects, *parts], **known), 2)][-1].probes["tip"]
        for parts in ([rf.Reduced(shapes=shapes)], [])
    )
    assert abs(own[2] - twin[2]) < allowed * twin[2]


def test_parts_on_joints_are_shown_where_these_hold_them():
    """K does not know how a hinge and a guide share it, which forces of second order tell."""
    places = {"root": (0, 0.1, 0.1), "middle": (1, 0.1, 0.1)}
    face, y = rf.MeanFace, (0, 1, 0)
    joints = [
        rf.Revolute("ground", face("x0"), (0, 0.1, 0.1), y),
        rf.Prismatic("ground", face("x1"), (2, 0.1, 0.1), (1, 0, 0)),
        rf.Traction("z1", (0, 0, 3e3), time=lambda t: np.sin(20 * t)),
    ]
    domain = rf.box((0, 0, 0), (2.0, 0.2, 0.2), (20, 2, 2))
    soft = replace(SOFT, E=5e7)

    def last(*reduced):
        known = {"probes": places, "element": "enhanced"}
        scene = rf.Scene(domain, soft, [*joints, *reduced], **known)
        return list(rf.simulate(scene, 2e-3, 0.1, progress=False))[-1]

    own, twin = last(rf.Reduced()), last()
    middle = twin.probes["middle"][0]
    assert middle < -1e-4
    assert own.probes["middle"][0] == pytest.approx(middle, rel=0.1)
    assert abs(own.probes["root"][0]) < 0.01 * abs(middle)


def test_bodies_that_are_found_show_it(tmp_path):
    """A restart goes on as the run."""
    grow = rf.StrainRate(2e-3, DT, patience=1)
    u, _, last, _ = followed(bar(2e3), rigidify=grow)
    twin, *_ = followed(bar(2e3))
    assert last.rigid.of.shapes is not None
    assert 0 < last.bodies[0].nu <= 0.003
    assert np.abs(u - twin)[:, :, 0].max() < 1e-3 * np.abs(twin).max()
    left = rf.Checkpoint(tmp_path, steps=20)
    more = gone_on(partial(bar, 2e3), DT, T_END, left, 26, rigidify=grow)
    size = np.abs(twin).max()
    assert more[-1].probes["tip"] == pytest.approx(last.probes["tip"], abs=1e-9 * size)


def _found():
    """Displacements that are the same on any number of ranks."""
    return followed(bar(1.5e4, rf.Reduced()), 0.05)[0].tolist()


@pytest.mark.parallel
def test_it_is_the_same_on_two_ranks():
    """To Newton's tolerance, along the bar."""
    one, two = (np.array(found)[:, :, 0] for found in (_found(), run(__file__, 2, 300)))
    assert np.abs(one - two).max() < 1e-6 * np.abs(one).max()


if __name__ == "__main__":
    found = _found()
    if MPI.COMM_WORLD.rank == 0:
        report(found)
