"""Freezing and releasing hand-made states: momenta, energy, and what comes back.

Energies and momenta are summed up here, by forms of this file. Run as a script under mpirun, this
file reports the errors that the ranks find.
"""

from __future__ import annotations

import dolfinx.mesh as dmesh
import numpy as np
import parallel
import pytest
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from scipy.spatial.transform import Rotation

import rigidfx as rf
from rigidfx.decide.decision import PlannedBody
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, BodyMotion
from rigidfx.state import State
from rigidfx.step.system.supports import PrescribedDofs, supports_of
from rigidfx.switch.consistent_exchange import ConsistentExchange
from rigidfx.switch.exchange import LumpedExchange
from rigidfx.switch.inventory import divide

RHO, E, NU = 2.0, 50.0, 0.3
SIZE = (5, 2, 2)
POINT = 3.0  # kg
EXCHANGES = {"lumped": LumpedExchange, "consistent": ConsistentExchange}
MASSES = pytest.mark.parametrize("mass", EXCHANGES)
CELLS = pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
EXACT = 1e-13  # relative


class Case:
    """A block in a random state of motion and strain, whose cells are frozen and released by hand.

    Attributes:
        scene: The block, with a point mass at a corner.
        state: The state.
    """

    def __init__(self, mass, *effects, cell="hexahedron"):
        domain = rf.box((0, 0, 0), SIZE, SIZE, cell)
        domain = domain.with_cells("end", lambda x: x[0] > 4 - 1e-9)
        domain = domain.with_vertices("corner", lambda x: np.isclose(x.sum(axis=0), 9.0))
        material = rf.StVenantKirchhoff(rho=RHO, E=E, nu=NU)
        effects = [rf.PointMass("corner", POINT), *effects]
        self.scene = scene = rf.Scene(domain, material, effects, mass=mass)
        self.state = State(scene)
        self.forces = InternalForces(scene, self.state.u)
        self.exchange = EXCHANGES[mass](scene, self.forces)
        owned = np.arange(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
        self.middle = dmesh.compute_midpoints(scene.mesh, 3, owned)
        self.supports = supports_of(scene.acting(0.0))
        self.prescribed = PrescribedDofs(scene, self.supports).mask
        self._forms()
        X = self.state.X
        strained = 0.05 * np.sin(X[:, [1, 2, 0]] + 2 * X)
        turned = X @ Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix().T - X
        self.state.place((strained + turned).reshape(-1))
        self.push(0)
        # named bodies come before what is found
        division = divide(scene, self.forces, self.state, ())
        rng = np.random.default_rng(5)
        self.state.group(
            Bodies.of_each(
                Body(b.data, BodyMotion(b.motion.r, np.eye(3), *rng.standard_normal((2, 3))))
                for b in division.bodies
            )
        )

    def _forms(self):
        scene, u = self.scene, self.state.u
        self._v = fem.Function(scene.space)
        test = ufl.TestFunction(scene.space)
        G = ufl.grad(u)
        strain = (G + G.T + G.T * G) / 2
        lam, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
        self._flexible = fem.Function(fem.functionspace(scene.mesh, ("DG", 0)))
        dx = ufl.dx(metadata={"quadrature_degree": scene.quadrature_degree})
        W = lam / 2 * ufl.tr(strain) ** 2 + mu * ufl.inner(strain, strain)
        self._energy = fem.form(self._flexible * W * dx)
        trial = ufl.TrialFunction(scene.space)
        exact = ufl.dx(metadata={"quadrature_degree": 4})
        self._mass = fem.form(RHO * self._flexible * ufl.inner(trial, test) * exact)

    # What changes the state ---------------------------------------------------------------------

    def push(self, seed):
        """Random velocities at all nodes."""
        X = self.state.X
        rng = np.random.default_rng(seed)
        # a field that does not depend on who owns a node
        waves = np.sin(X @ rng.uniform(-9, 9, (3, 7)) + rng.uniform(0, 6, 7))
        spin = np.cross([0.2, -0.4, 0.6], X)
        self.state.move((waves @ rng.standard_normal((7, 3)) + spin).reshape(-1))

    def planned(self, low, high, number, name="found", named=()):
        """A body of the cells between two x."""
        x = self.middle[:, 0]
        cells = np.flatnonzero((x > low) & (x < high)).astype(np.int32)
        at = self.state.X[: self.scene.owned_nodes, 0]
        nodes = np.flatnonzero((at > low - 1e-9) & (at < high + 1e-9)).astype(np.int32)
        return PlannedBody(cells, nodes, name, number, named)

    def freeze(self, low, high, number):
        planned = self.planned(low, high, number)
        work = self.exchange.freeze(self.state, planned, self.prescribed)
        assert work is not None
        return work.whole

    def release(self, *numbers):
        return self.exchange.release(self.state, set(numbers), self.prescribed).whole

    def fly(self, seed):
        """Move bodies as steps would: nodes that flexible cells touch go along, others lag behind.

        With a consistent mass the flexible side of an interface has velocities of its own.
        """
        rng = np.random.default_rng(seed)
        bodies = Bodies.of_each(
            Body(
                b.data,
                BodyMotion(
                    b.motion.r + 0.2 * rng.standard_normal(3),
                    Rotation.from_rotvec(0.3 * rng.standard_normal(3)).as_matrix() @ b.motion.R,
                    *rng.standard_normal((2, 3)),
                ),
            )
            for b in self.state.bodies
        )
        n = self.scene.owned_nodes
        u, v = self.displacements, self.velocities
        for body in bodies:
            nodes = body.data.nodes
            there = self.touched[nodes] > 0
            u[nodes] = np.where(there[:, None], body.positions - self.state.X[nodes], 7.0)
            v[nodes] = np.where(there[:, None], v[nodes], 7.0)
        field = fem.Function(self.scene.space)
        field.x.array[: 3 * n] = u.reshape(-1)
        field.x.scatter_forward()
        self.state.place(field.x.array)
        self.state.move(v.reshape(-1))
        self.state.group(bodies)

    # What is measured ---------------------------------------------------------------------------

    @property
    def touched(self):
        """Number of flexible cells at each owned node, none of them zero. Collective."""
        mark = fem.Function(self.scene.space)
        cells = np.flatnonzero(self.state.body_numbers() == 0)
        np.add.at(mark.x.array, 3 * self.scene.space.dofmap.list[cells].reshape(-1), 1.0)
        mark.x.petsc_vec.ghostUpdate(addv=True, mode=True)
        return mark.x.array[::3][: self.scene.owned_nodes]

    def sums(self):
        """H, L and J, and the sizes of each. Collective."""
        state, scene, n = self.state, self.scene, self.scene.owned_nodes
        number = state.body_numbers()
        self._flexible.x.array[: number.size] = number == 0
        self._flexible.x.scatter_forward()
        v = state.v.x.array[: 3 * n]
        x = (state.X + state.u.x.array.reshape(-1, 3))[:n].copy()
        apart = np.ones(n, dtype=bool)
        for body in state.bodies:
            apart[body.data.nodes] = False
            x[body.data.nodes] = body.positions
        if scene.mass == "lumped":
            p = np.where(apart, scene.nodal_mass[:n], 0.0).repeat(3) * v
        else:
            M = fem_petsc.assemble_matrix(self._mass)
            M.assemble()
            a, b = M.createVecs()
            a.array[:] = v
            M.mult(a, b)
            p = b.array_r + np.where(apart, scene.point_masses[:n], 0.0).repeat(3) * v
            for item in (M, a, b):
                item.destroy()
        nodal = p.reshape(-1, 3)
        local = [0.5 * v @ p, fem.assemble_scalar(self._energy), np.abs(nodal).sum()]
        moments = np.cross(x, nodal)
        total = scene.sum(np.r_[local, nodal.sum(0), moments.sum(0), np.abs(moments).sum()])
        H, size, L, J, size_J = total[0] + total[1], total[2], total[3:6], total[6:9], total[9]
        for body in state.bodies:
            motion, frozen = body.motion, body.data.frozen
            W, inertia = motion.angular_velocity_body, body.data.inertia
            own, spin = body.data.mass * motion.velocity, motion.R @ inertia @ W
            H += 0.5 * motion.velocity @ own + 0.5 * W @ inertia @ W
            H += frozen.strain + frozen.vibration
            L, J = L + own, J + np.cross(motion.r, own) + spin
            size, size_J = size + np.abs(own).sum(), size_J + np.abs(spin).sum()
        return H, L, J, size, size_J

    def change(self, action):
        """Relative changes of H, L and J by an action, but for work of supports. Collective."""
        H, L, J, size, size_J = self.sums()
        H += action() or 0.0
        H1, L1, J1, *_ = self.sums()
        return {
            "H": abs(H1 - H) / abs(H),
            "L": np.abs(L1 - L) / size,
            "J": np.abs(J1 - J) / size_J,
        }

    @property
    def displacements(self):
        """Those of all owned nodes, shape (nodes, 3) [m]."""
        return self.state.u.x.array[: 3 * self.scene.owned_nodes].copy().reshape(-1, 3)

    @property
    def velocities(self):
        """Those of all owned nodes, shape (nodes, 3) [m/s]."""
        return self.state.v.x.array[: 3 * self.scene.owned_nodes].copy().reshape(-1, 3)

    def largest(self, values):
        """Largest absolute value on any rank."""
        return self.scene.comm.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX)


def worst(changes):
    return max(float(np.max(value)) for value in changes.values())


# Balances --------------------------------------------------------------------------------------


def story(mass, cell="hexahedron", effects=()):
    """Changes of H, L, J in the life of some bodies. Collective."""
    case, found = Case(mass, *effects, cell=cell), {}

    def note(what, action):
        found[what] = worst(case.change(action))

    note("freeze", lambda: case.freeze(0, 1, 10))
    case.fly(1)
    note("freeze another", lambda: case.freeze(2, 3, 11))
    case.fly(2)

    def grow():
        case.release(10)
        case.freeze(0, 1, 10)

    note("freeze again", grow)
    note("release one", lambda: case.release(10))
    note("freeze beside", lambda: case.freeze(0, 1, 12))
    case.fly(3)

    def merge():
        case.release(11, 12)
        case.freeze(0, 3, 11)

    note("merge", merge)
    case.fly(4)
    case.push(9)
    note("release", lambda: case.release(11))
    return found


@MASSES
@CELLS
def test_balances(mass, cell):
    """However bodies have moved, no energy and no momentum goes or comes."""
    for what, change in story(mass, cell).items():
        assert change <= EXACT, what


@MASSES
def test_balances_beside_a_body_of_given_mass(mass):
    """Its momenta are by the given mass, and are nobody else's."""
    given = rf.Rigid("end", mass=70.0, inertia=np.diag([50.0, 60.0, 70.0]))
    for what, change in story(mass, effects=[given]).items():
        assert change <= EXACT, what


@MASSES
def test_body_has_the_momenta_of_its_mass(mass):
    """All frozen at once: mass, centre, momenta and energy are those of the nodes."""
    case = Case(mass)
    H, L, J, size, size_J = case.sums()
    case.freeze(0, 5, 1)
    (body,) = case.state.bodies
    motion, data = body.motion, body.data
    assert data.mass == pytest.approx(RHO * 20 + POINT, rel=1e-14)
    assert np.abs(data.mass * motion.velocity - L).max() <= EXACT * size
    spin = motion.R @ data.inertia @ motion.angular_velocity_body
    assert np.abs(np.cross(motion.r, L) + spin - J).max() <= EXACT * size_J
    kinetic = motion.kinetic(data)
    assert kinetic + data.frozen.energy == pytest.approx(H, rel=EXACT)
    assert data.frozen.vibration > 0.1 * kinetic
    assert data.frozen.strain > 1.0


# What comes back -------------------------------------------------------------------------------


@MASSES
def test_release_at_once_gives_all_back(mass):
    """Velocities and displacements of all nodes are what they were."""
    case = Case(mass)
    v, u = case.velocities, case.displacements
    case.freeze(1, 3, 1)
    inside = case.touched == 0
    assert np.count_nonzero(inside) == 9  # of 27 nodes of the body
    case.state.move(np.where(inside[:, None], 7.0, case.velocities).reshape(-1))  # lags behind
    case.release(1)
    scale = case.largest(v)
    assert case.largest(case.velocities - v) <= 10 * EXACT * scale
    assert case.largest(case.displacements - u) <= EXACT
    assert len(case.state.bodies) == 0


def test_the_flexible_side_of_an_interface_has_energy_of_its_own():
    """It is given back where a body has kept no velocities that could take it up."""
    case = Case("consistent")
    X = case.state.X + case.state.u.x.array.reshape(-1, 3)
    case.state.move((np.array([1.0, -2.0, 0.5]) + np.cross([0.3, 0.2, -0.4], X)).reshape(-1))
    case.freeze(1, 3, 1)
    (body,) = case.state.bodies
    assert body.data.frozen.vibration <= EXACT * case.sums()[0]
    there = body.data.nodes[case.touched[body.data.nodes] > 0]
    v, own = case.velocities, np.random.default_rng(3).standard_normal((there.size, 3))
    rigid = v[there].copy()
    v[there] += own
    case.state.move(v.reshape(-1))
    assert worst(case.change(lambda: case.release(1))) <= EXACT
    # It goes where it came from, but for the little that the body had in common with it.
    new = case.velocities[there] - rigid
    cosine = np.vdot(new, own) / np.sqrt(np.vdot(new, new) * np.vdot(own, own))
    assert cosine > 0.98


def test_difference_velocities_turn_with_the_body():
    """With a lumped mass v = ṙ + ω × R V + R ΔV, equation (41), and x = r + R V."""
    case = Case("lumped")
    v, x = case.velocities, case.state.X + case.displacements
    case.freeze(1, 3, 1)
    (body,) = case.state.bodies
    nodes, c, c_dot = body.data.nodes, body.motion.r, body.motion.velocity
    omega = body.motion.angular_velocity
    others = np.setdiff1d(np.arange(len(v)), nodes)
    case.fly(3)
    (moved,) = (b.motion for b in case.state.bodies)
    case.release(1)
    V = x[nodes] - c
    dV = v[nodes] - c_dot - np.cross(omega, V)
    wanted = moved.velocity + np.cross(moved.R @ moved.angular_velocity_body, V @ moved.R.T)
    wanted += dV @ moved.R.T
    assert case.largest(case.velocities[nodes] - wanted) <= EXACT * case.largest(wanted)
    positions = (case.state.X + case.displacements)[nodes]
    assert case.largest(positions - moved.r - V @ moved.R.T) <= EXACT
    assert np.array_equal(case.velocities[others], v[others])


def test_growth_is_a_release_and_a_freeze():
    """With a lumped mass a body that has grown is one that has been frozen so at once."""
    one, two = Case("lumped"), Case("lumped")
    one.freeze(1, 2, 1)
    one.release(1)
    one.freeze(1, 4, 1)
    two.freeze(1, 4, 1)
    a, b = one.state.bodies[0], two.state.bodies[0]
    for x, y in (
        (a.data.mass, b.data.mass),
        (a.data.inertia, b.data.inertia),
        (a.data.offsets, b.data.offsets),
        (a.motion.r, b.motion.r),
        (a.motion.velocity, b.motion.velocity),
        (a.motion.angular_velocity, b.motion.angular_velocity),
        (a.data.frozen.velocities, b.data.frozen.velocities),
        (a.data.frozen.strain, b.data.frozen.strain),
        (a.data.frozen.vibration, b.data.frozen.vibration),
    ):
        assert np.abs(np.subtract(x, y)).max() <= EXACT * max(1.0, np.abs(y).max())
    assert a.data.size == 3 * 4


def test_other_bodies_are_left_alone():
    """With a lumped mass nothing of a body changes where another one goes or comes."""
    case = Case("lumped")
    case.freeze(0, 1, 1)
    case.freeze(2, 3, 2)
    case.fly(1)
    before = case.state.bodies[0]
    case.release(2)
    case.freeze(3, 5, 3)
    after = case.state.bodies[0]
    assert after.data is before.data
    assert np.array_equal(after.motion.velocity, before.motion.velocity)
    assert np.array_equal(after.motion.angular_velocity, before.motion.angular_velocity)
    assert np.array_equal(after.motion.R, before.motion.R)
    assert [b.number for b in case.state.bodies.of.records] == [1, 3]


@MASSES
def test_what_cannot_be_a_body(mass):
    """Without cells there is no inertia: the answer is no, and nothing changes."""
    case = Case(mass)
    v, bodies = case.velocities, case.state.bodies
    nothing = np.empty(0, np.int32)
    body = PlannedBody(nothing, nothing, "nothing", 1)
    assert case.exchange.freeze(case.state, body, case.prescribed) is None
    assert np.array_equal(case.velocities, v)
    assert case.state.bodies is bodies


# Beside supports -------------------------------------------------------------------------------

# What a support leaves free is a motion of the whole whose momentum no freeze changes.
SUPPORTS = {
    "nothing held": ([], [0, 1, 2], [0, 1, 2]),
    "a face": ([rf.Fixed("x0")], [], []),
    "a face in z": ([rf.Fixed("x0", "z")], [0, 1], [2]),
    "a face in x and y": ([rf.Fixed("x0", "xy")], [2], []),
}


def beside(name, mass, moving):
    """Largest changes of held velocities, H, and free components of L and J. Collective."""
    effects, free_L, free_J = SUPPORTS[name]
    case = Case(mass, *effects)
    v = case.velocities.reshape(-1)
    if not moving:
        v[case.prescribed] = 0.0
        case.state.move(v)
    held = v[case.prescribed]
    found = {"held": 0.0, "H": 0.0, "L": 0.0, "J": 0.0, "others": 0.0}
    for k, action in enumerate(
        (
            lambda: case.freeze(1, 2, 1),
            lambda: case.freeze(3, 4, 2),
            lambda: case.release(1),
            lambda: case.freeze(1, 2, 3),
            lambda: case.release(2, 3),
        )
    ):
        case.fly(k)
        change = case.change(action)
        after = case.velocities.reshape(-1)
        found["held"] = max(found["held"], case.largest(after[case.prescribed] - held))
        found["H"] = max(found["H"], change["H"])
        found["L"] = max([found["L"], *change["L"][free_L]])
        found["J"] = max([found["J"], *change["J"][free_J]])
        found["others"] = max([found["others"], *change["L"]])
    return found


@pytest.mark.parametrize("name", SUPPORTS)
def test_supports_at_rest(name):
    """Held dofs stay, energy is kept, and so are the momenta that the support leaves free."""
    found = beside(name, "consistent", moving=False)
    assert found["held"] == 0.0
    assert max(found["H"], found["L"], found["J"]) <= EXACT, found
    # through the mass a support takes part in the others
    assert name == "nothing held" or found["others"] > 1e-8


@pytest.mark.parametrize("name", ["a face", "a face in z"])
def test_supports_that_move(name):
    """With any velocity of the held dofs."""
    found = beside(name, "consistent", moving=True)
    assert found["held"] == 0.0
    assert max(found["H"], found["L"], found["J"]) <= EXACT, found


# On several ranks ------------------------------------------------------------------------------


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [3])
def test_on_several_ranks(ranks):
    """With bodies that span them."""
    found = parallel.run(__file__, ranks, timeout=300)
    assert found["spans"]
    for mass in EXCHANGES:
        for what, change in found[mass].items():
            assert change <= EXACT, (mass, what)
    for what in ("held", "H", "L", "J"):
        assert found["beside"][what] <= EXACT, what


def main():
    comm = MPI.COMM_WORLD
    given = rf.Rigid("end", mass=70.0, inertia=np.diag([50.0, 60.0, 70.0]))
    found = {mass: story(mass, effects=[given]) for mass in EXCHANGES}
    found["beside"] = beside("a face in z", "consistent", moving=False)
    sizes = comm.allgather(Case("lumped").planned(0, 3, 1).cells.size)
    found["spans"] = sum(size > 0 for size in sizes) > 1
    if comm.rank == 0:
        parallel.report(found)


if __name__ == "__main__":
    main()
