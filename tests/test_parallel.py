"""Histories on 1, 2 and 3 ranks are the same.

Run as a script under mpirun, this file integrates its scenes and reports their histories.
"""

import numpy as np
import parallel
import pytest
from histories import apart, between, largest
from mpi4py import MPI

import rigidfx as rf

# The bound; Newton's tolerance leaves some 1e-12 a step.
TOLERANCE = 1e-9


def _tumbling():
    """The reference problem."""
    from histories import tumbling

    material, probes = rf.StVenantKirchhoff(rho=10.0, E=1e4, nu=0.3), {"tip": (0.0, 10.0, 0.0)}
    return tumbling(material, load=4.0, probes=probes), 0.2, 6.0


def _everything():
    """Tetrahedra, two materials, consistent mass, damping, windows, an impact, a moved face."""
    domain = rf.box((0, 0, 0), (4, 1, 1), (6, 2, 2), "tetrahedron")
    domain = domain.with_cells("left", lambda x: x[0] < 2 + 1e-9)
    domain = domain.with_cells("right", lambda x: x[0] > 2 - 1e-9)
    gravity = rf.Gravity((0.0, -0.05, 0.0))

    def path(t):
        return (0.1 * (t - 1.0), 0.05 * (t - 1.0) ** 2, 0.0)

    scene = rf.Scene(
        domain,
        {
            "left": rf.NeoHooke(rho=2.0, E=50.0, nu=0.3),
            "right": rf.NeoHooke(rho=1.0, E=80.0, nu=0.4),
        },
        [
            gravity,
            rf.Preload([gravity], increments=2),
            rf.Fixed("x0"),
            rf.Fixed("z1", "z", since=2.0),
            rf.PrescribedMotion("x1", "xy", displacement=path, since=1.0, until=3.0),
            rf.Traction("y1", (0.1, 0.2, 0.3), since=0.33, until=2.5),
            rf.NumericalDamping(0.05, since=3.5),
        ],
        mass="consistent",
        probes={"tip": (4.0, 1.0, 1.0), "inside": (2.2, 0.6, 0.3)},
    )
    return scene, 0.2, 5.0


def _second_order():
    """Hexahedra of second order with lumped mass, large enough for the Krylov solver."""
    spin = rf.InitialVelocity(angular=(0.1, 0.2, 0.3), linear=(1.0, 0.0, 0.0))
    scene = rf.Scene(
        rf.box((0, 0, 0), (4, 1, 1), (6, 2, 2)),
        rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3),
        [spin, rf.NodalForce("x1", (0.0, 3.0, 0.0), until=1.0)],
        order=2,
        probes={"tip": (4.0, 1.0, 1.0)},
    )
    return scene, 0.2, 2.0


def _long():
    """Nine tenths rigid, tumbling: the body is on all ranks, and some hold nothing else."""
    domain = rf.box((0, 0, 0), (20, 1, 1), (20, 1, 1)).with_cells("stiff", between(0, 18))
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


def _two():
    """Two bodies of tetrahedra, one of given mass, one that a support stops and lets go."""
    domain = rf.box((0, 0, 0), (9, 2, 2), (9, 2, 2), "tetrahedron")
    for name, low, high in (("left", 0, 3), ("right", 6, 9)):
        domain = domain.with_cells(name, between(low, high))
    scene = rf.Scene(
        domain,
        rf.NeoHooke(rho=1.0, E=2e4, nu=0.2),
        [
            rf.Rigid("left"),
            rf.Rigid("right", mass=20.0, inertia=[[20, 1, 0], [1, 25, 2], [0, 2, 30]]),
            rf.InitialVelocity(angular=(0.3, 1.0, 3.0)),
            rf.NodalForce("y1", (3.0, 5.0, 1.0), until=0.5),
            rf.Fixed("x0", since=0.5, until=0.8),
        ],
        mass="consistent",
        probes={"on the body": (1.2, 0.3, 0.6), "on the rest": (4.6, 1.6, 0.3)},
    )
    return scene, 0.1, 1.0


def _rigid():
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


SCENES = {
    "tumbling": _tumbling,
    "everything": _everything,
    "second order": _second_order,
    "long": _long,
    "two": _two,
    "rigid": _rigid,
}


def _history(scene, dt, t_end):
    """What is recorded, step by step, as plain lists; and a scale for each."""
    rows = []
    for r in rf.simulate(scene, dt, t_end):
        row = {
            "t": r.t,
            "unknowns": r.unknowns,
            "energy": [r.kinetic, r.strain, r.work_of_loads, r.work_of_supports],
            "linear momentum": list(r.linear_momentum),
            "angular momentum": list(r.angular_momentum),
            "displacement": [float(x) for u in r.probes.values() for x in u],
            "reactions": [float(x) for name in sorted(r.reactions) for x in r.reactions[name]],
            "impact": [] if r.impact is None else [r.impact.energy, *r.impact.impulse],
            "bodies": [
                float(x)
                for b in r.bodies
                for x in (*b.centre, *b.orientation.ravel(), *b.angular_momentum_about_centre)
            ],
        }
        r.state.rebuild()
        owned = [f.x.array[: 3 * scene.owned_nodes] for f in (r.state.u, r.state.v)]
        row["norms"] = [float(np.sqrt(scene.sum(f @ f))) for f in owned]
        row["momentum scale"] = r.momentum_scale
        rows.append(row)
    return rows


@pytest.fixture(scope="module")
def histories():
    return {n: parallel.run(__file__, n, timeout=600) for n in (1, 3)}


@pytest.mark.parallel
@pytest.mark.parametrize("name", SCENES)
def test_history_is_that_on_one_rank(histories, name):
    """Energies, momenta, displacements, reactions and impacts, each relative to its largest."""
    one, several = histories[1][name], histories[3][name]
    assert [row["t"] for row in several] == [row["t"] for row in one]
    assert [row["unknowns"] for row in several] == [row["unknowns"] for row in one]
    momentum = max(row["momentum scale"] for row in one)
    for key in ("energy", "linear momentum", "angular momentum", "displacement", "reactions",
                "impact", "bodies", "norms"):  # fmt: skip
        # Components that vanish are rounding of what they are sums of.
        scale = max(largest(one, key), momentum if "momentum" in key else 0.0)
        worst = apart(one, several, key)
        print(f"{key}: {worst / scale if scale else 0.0:.2g}")
        assert worst <= TOLERANCE * scale


@pytest.mark.parallel
def test_there_is_something_to_compare(histories):
    """Motions, reactions and impacts, on as many ranks as asked for."""
    assert sum(bool(row["impact"]) for row in histories[1]["everything"]) >= 2
    assert sum(bool(row["impact"]) for row in histories[1]["two"]) == 1
    assert histories[1]["rigid"][0]["unknowns"] == 6
    assert largest(histories[1]["everything"], "reactions") > 0
    for name in SCENES:
        assert largest(histories[1][name], "displacement") > 0.05
    assert largest(histories[1]["tumbling"], "energy") > 1e3
    assert [histories[n]["ranks"] for n in (1, 3)] == [1, 3]


if __name__ == "__main__":
    results = {name: _history(*make()) for name, make in SCENES.items()}
    parallel.report({**results, "ranks": MPI.COMM_WORLD.size})
