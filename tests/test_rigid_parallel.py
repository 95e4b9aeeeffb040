"""Histories of scenes with rigid bodies on 1, 2 and 3 ranks are the same.

Run as a script under mpirun, this file integrates its scenes and reports their histories, and which
ranks hold which cells of the bodies.
"""

from __future__ import annotations

import numpy as np
import parallel
import pytest
from histories import apart, largest
from mpi4py import MPI
from runs import prepared

import rigidfx as rf

# The bound; Newton's tolerance leaves some 1e-12 a step.
TOLERANCE = 1e-9


def _between(low, high):
    return lambda x: (x[0] >= low - 1e-9) & (x[0] <= high + 1e-9)


def _long():
    """Nine tenths rigid, tumbling: the body is on all ranks, and some hold nothing else."""
    domain = rf.box((0, 0, 0), (20, 1, 1), (20, 1, 1)).with_cells("stiff", _between(0, 18))
    scene = rf.Scene(
        domain,
        rf.StVenantKirchhoff(rho=1.0, E=1e4, nu=0.3),
        [
            rf.Rigid("stiff"),
            rf.InitialVelocity(angular=(0.1, 0.5, 1.0), linear=(0.3, 0.0, 0.1)),
            rf.Traction("x0", (0.0, 1.0, 2.0), until=1.0),
            rf.Gravity((0.0, -0.1, 0.0)),
            rf.Resultant("stiff", force=(1.0, 0.0, 0.0), torque=(10.0, 0.0, 20.0), until=0.55),
        ],
        probes={"on the body": (3.3, 0.2, 0.6), "on the rest": (19.4, 0.6, 0.3)},
    )
    return scene, 0.1, 1.5


def _two(mass="consistent"):
    """Two bodies of tetrahedra with a flexible piece between, large steps, two materials."""
    domain = rf.box((0, 0, 0), (9, 2, 2), (9, 2, 2), "tetrahedron")
    for name, low, high in (("left", 0, 3), ("right", 6, 9), ("first", 0, 5), ("last", 5, 9)):
        domain = domain.with_cells(name, _between(low, high))
    scene = rf.Scene(
        domain,
        {
            "first": rf.StVenantKirchhoff(rho=2.0, E=3e4, nu=0.3),
            "last": rf.NeoHooke(rho=1.0, E=2e4, nu=0.2),
        },
        [
            rf.Rigid("left"),
            rf.Rigid("right", mass=20.0, inertia=[[20, 1, 0], [1, 25, 2], [0, 2, 30]]),
            rf.InitialVelocity(angular=(0.3, 1.0, 3.0)),
            rf.NodalForce("y1", (3.0, 5.0, 1.0), until=0.5),
        ],
        mass=mass,
        probes={"on the body": (1.2, 0.3, 0.6), "on the rest": (4.6, 1.6, 0.3)},
    )
    return scene, 0.1, 1.2


def _along():
    """A layer along the bar is rigid, so that the body has an interface on every rank."""
    domain = rf.box((0, 0, 0), (12, 2, 2), (12, 2, 2))
    domain = domain.with_cells("stiff", lambda x: x[2] <= 1 + 1e-9)
    scene = rf.Scene(
        domain,
        rf.NeoHooke(rho=1.0, E=1e3, nu=0.3),
        [
            rf.Rigid("stiff"),
            rf.InitialVelocity(
                angular=(0.5, 0.2, 0.6),
                function=lambda X: np.array([0 * X[0], 0.3 * (X[2] > 1.5), 0 * X[0]]),
            ),
        ],
        probes={"on the body": (1.2, 0.3, 0.6), "on the rest": (7.6, 1.6, 1.9)},
    )
    return scene, 0.1, 1.2


def _everything():
    """All cells rigid: six unknowns, on one rank."""
    scene = rf.Scene(
        rf.box((0, 0, 0), (4, 2, 1), (4, 2, 1)),
        rf.StVenantKirchhoff(rho=1.0, E=1e3, nu=0.3),
        [
            rf.Rigid(),
            rf.InitialVelocity(angular=(0.5, 1.2, 0.3)),
            rf.Traction("x0", (0.1, 0.2, 0.3)),
        ],
        probes={"on the body": (1.2, 0.3, 0.6)},
    )
    return scene, 0.2, 2.0


def _clamped():
    """A body stopped by a support and let go again, beside one that stays free."""
    domain = rf.box((0, 0, 0), (9, 1, 1), (9, 1, 1))
    domain = domain.with_cells("left", _between(0, 3)).with_cells("right", _between(6, 9))
    scene = rf.Scene(
        domain,
        rf.StVenantKirchhoff(rho=2.0, E=500.0, nu=0.3),
        [
            rf.Rigid("left"),
            rf.Rigid("right"),
            rf.Fixed("x0", since=0.5, until=1.0),
            rf.InitialVelocity(linear=(0.3, 0.2, -0.1), angular=(0.1, 0.2, 0.3)),
        ],
        mass="consistent",
        probes={"on the body": (1.2, 0.3, 0.6), "on the rest": (4.6, 0.6, 0.3)},
    )
    return scene, 0.1, 1.4


SCENES = {
    "long": _long,
    "two": _two,
    "along": _along,
    "everything": _everything,
    "clamped": _clamped,
}
KEYS = ("centre", "orientation", "velocity", "spin", "energy", "momentum", "displacement",
        "reactions", "impact", "norms")  # fmt: skip


def _history(scene, dt, t_end):
    """What is recorded, step by step, as plain lists."""
    rows = []
    for r in rf.simulate(scene, dt, t_end):
        row = {
            "t": r.t,
            "unknowns": r.unknowns,
            "iterations": r.iterations,
            "names": [b.name for b in r.bodies],
            "centre": [b.centre for b in r.bodies],
            "orientation": [b.orientation.reshape(-1) for b in r.bodies],
            "velocity": [b.velocity for b in r.bodies],
            "spin": [b.angular_momentum_about_centre for b in r.bodies],
            "energy": [[r.kinetic, r.strain, r.work_of_loads, r.work_of_supports]],
            "momentum": [r.linear_momentum, r.angular_momentum],
            "displacement": list(r.probes.values()),
            "reactions": [r.reactions[name] for name in sorted(r.reactions)],
            "impact": [] if r.impact is None else [[r.impact.energy], r.impact.impulse],
        }
        r.state.rebuild()
        n = 3 * scene.owned_nodes
        norms = [scene.sum(f.x.array[:n] @ f.x.array[:n]) for f in (r.state.u, r.state.v)]
        row["norms"] = [np.sqrt(norms)]
        for key in KEYS:
            row[key] = [float(x) for part in row[key] for x in part]
        rows.append(row)
    return rows


def _ownership(scene):
    """For each rank: its cells, its flexible cells, and its cells and nodes of each body."""
    with prepared(scene) as run:
        system = run.stepper.system
        part = system.layout
        mine = {
            "cells": int(scene.mesh.topology.index_map(3).size_local),
            "flexible": int(sum(c.size for c in part.flexible.values())),
            "of bodies": [int(b.cells.size) for b in part.bodies],
            "attached": [int(at.size) for at in part.attached],
            "unknowns of bodies": int(system.equilibrium.prolongation.owned_bodies.size),
        }
        return scene.comm.gather(mine)


@pytest.fixture(scope="module")
def histories():
    return {n: parallel.run(__file__, n, timeout=600) for n in (1, 3)}


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [3])
@pytest.mark.parametrize("name", SCENES)
def test_history_is_that_on_one_rank(histories, name, ranks):
    """Bodies, energies, momenta, probes, norms of the fields, each relative to its largest."""
    one, several = histories[1][name], histories[ranks][name]
    for key in ("t", "unknowns", "names"):
        assert [row[key] for row in several] == [row[key] for row in one]
    newton = [sum(row["iterations"] for row in rows) for rows in (one, several)]
    assert abs(newton[0] - newton[1]) <= 0.1 * newton[0]
    for key in KEYS:
        scale, worst = largest(one, key), apart(one, several, key)
        print(f"{key}: {worst / scale if scale else 0.0:.2g}")
        assert worst <= TOLERANCE * scale, key


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [3])
def test_bodies_lie_across_ranks(histories, ranks):
    """The scenes have what they are meant for: see each assertion."""
    owned = histories[ranks]["ownership"]
    assert all(len(of_ranks) == ranks for of_ranks in owned.values())
    # a body with cells on all ranks, one of which holds nothing but rigid cells
    assert all(rank["of bodies"][0] > 0 for rank in owned["long"])
    assert any(rank["cells"] > 0 and rank["flexible"] == 0 for rank in owned["long"])
    # a body with interface nodes on all ranks
    assert all(rank["attached"][0] > 0 for rank in owned["along"])
    # six unknowns have one owner, and other ranks may own none
    for name, of_ranks in owned.items():
        bodies = len(of_ranks[0]["of bodies"])
        assert sum(rank["unknowns of bodies"] for rank in of_ranks) == bodies, name
    assert sorted(rank["unknowns of bodies"] for rank in owned["everything"])[0] == 0


@pytest.mark.parallel
def test_there_is_something_to_compare(histories):
    """Bodies turn far, probes move, strains and impacts are there."""
    for name in SCENES:
        last = histories[1][name][-1]
        if name != "clamped":
            assert max(abs(np.array(last["orientation"][:9]) - np.eye(3).reshape(-1))) > 0.2
        assert max(abs(np.array(last["displacement"]))) > 0.05
        assert name == "everything" or last["energy"][1] > 0
    assert sum(bool(row["impact"]) for row in histories[1]["clamped"]) == 1
    assert histories[1]["everything"][0]["unknowns"] == 6


if __name__ == "__main__":
    results, ownership = {}, {}
    for name_, make in SCENES.items():
        results[name_] = _history(*make())
        ownership[name_] = _ownership(make()[0])
    if MPI.COMM_WORLD.rank == 0:
        parallel.report({**results, "ownership": ownership})
