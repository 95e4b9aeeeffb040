"""What somebody adds of his own, without a change of the package: obstacle, criterion, joint."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import own_spring
import parallel
import pytest
from histories import column, drift, show
from scipy.spatial import cKDTree

import rigidfx as rf
from rigidfx.decide.rules import RateRule
from rigidfx.decide.settings import Criterion
from rigidfx.effects.action import Action
from rigidfx.effects.base import Effect
from rigidfx.effects.contacts.obstacles import Approach, Obstacle
from rigidfx.effects.joints.sides import end_of
from rigidfx.effects.nodes import SharedNodes

MATERIAL = rf.StVenantKirchhoff(E=1e5, nu=0.3, rho=1000.0)


@dataclass(frozen=True)
class Floor(Obstacle):
    """All below z = 0."""

    def gap(self, y):
        return y[:, 2]

    def outward(self, y):
        return np.broadcast_to([0.0, 0.0, 1.0], y.shape)

    def approach(self, y0, y1):
        up = self.outward(y0)
        return Approach(up, None, up)


def test_an_obstacle_of_ones_own():
    """It does what the plane that it is does."""
    box = rf.box((0, 0, 0.01), (1, 1, 1.01), (2, 2, 2))
    thrown = rf.InitialVelocity(linear=(0.1, 0.0, -1.0))

    def heights(obstacle):
        contact = rf.Contact("z0", against=obstacle, title="floor")
        scene = rf.Scene(box, MATERIAL, [thrown, contact], probes={"top": (1, 1, 1.01)})
        reports = list(rf.simulate(scene, 0.005, 0.1))
        assert reports[-1].touches["floor"].nodes
        return [report.probes["top"] for report in reports]

    np.testing.assert_array_equal(heights(Floor()), heights(rf.Plane((0, 0, 0), (0, 0, 1))))


@dataclass(frozen=True)
class Patient(Criterion):
    """Everything freezes after a second."""

    wake = "none"
    window = 1.0

    def rule(self, scene, timeline, memory):
        return RateRule(scene, memory, 1e9, self.window, {})


def test_a_criterion_of_ones_own():
    """It is asked where `StrainRate` would be."""
    scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), MATERIAL)
    reports = list(rf.simulate(scene, 0.25, 1.5, rigidify=Patient()))
    kinds = [(report.t, event.kind) for report in reports for event in report.events]
    assert kinds == [(pytest.approx(1.0), "freeze")]
    assert reports[-1].unknowns == 6


@dataclass(frozen=True)
class Tie(Effect):
    """Springs of no length between the nodes of two faces, k in all [N/m]."""

    is_lasting: ClassVar[bool] = True
    where: str
    to: str
    k: float

    @property
    def joins(self):
        return self.where, self.to

    def bind(self, structure):
        return None if structure.notes is None else TieForces(self, structure)


class TieForces(Action):
    """A force k x½ on one node of each pair, minus that on the other: all balances are exact."""

    kind = "Tie"
    couples = True

    def __init__(self, tie, structure):
        """On one rank, which knows all nodes."""
        X = structure.scene.space.tabulate_dof_coordinates()
        nodes = np.concatenate([structure.scene.nodes(name, "Tie") for name in tie.joins])
        self.nodes = SharedNodes(structure, nodes, np.arange(nodes.size), nodes.size)
        n = nodes.size // 2
        _, mate = cKDTree(X[nodes[n:]]).query(X[nodes[:n]])
        self.pairs, self.k = np.c_[np.arange(n), n + mate], tie.k / n
        self.rounding = tie.k

    def resist(self, motion, forces):
        x = self.nodes.positions(motion.start) + 0.5 * self.nodes.moved(motion)
        a, b = self.pairs.T
        force = np.zeros_like(x)
        force[a] = self.k * (x[a] - x[b])
        force[b] = -force[a]
        self.nodes.add(force, forces)

    def stiffen(self, motion, tangent):
        G = np.stack([np.eye(3), -np.eye(3)], axis=1)  # [component, end, axis]
        every = np.tile(G, (len(self.pairs), 1, 1))
        pairs = np.repeat(self.pairs, 3, axis=0)
        self.nodes.couple(pairs, every, np.full(len(pairs), 0.5 * self.k), tangent)

    def stored(self, at):
        x = self.nodes.positions(at)
        a, b = self.pairs.T
        return 0.5 * self.k * np.vdot(x[a] - x[b], x[a] - x[b])


@pytest.mark.parametrize("rigid", [(), ("left",), ("left", "right")])
def test_a_joint_of_ones_own(rigid):
    """Two blocks tied at a face, flexible or in bodies: energy and both momenta stay."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    cell = np.array([[0, 4, 2, 6, 1, 5, 3, 7]])
    points = np.vstack([corners, corners + np.array([1.01, 0, 0])])
    pair = rf.from_arrays(points, np.vstack([cell, cell + 8]), "hexahedron")
    pair = pair.with_cells("left", lambda x: x[0] < 1.005).with_cells("right", lambda x: x[0] > 1.0)
    pair = pair.with_facets("a", lambda x: abs(x[0] - 1) < 1e-6)
    pair = pair.with_facets("b", lambda x: abs(x[0] - 1.01) < 1e-6)
    turning = rf.InitialVelocity(linear=(0.1, 0.2, 0.0), angular=(0.5, 0.0, 1.0))
    effects = [Tie("a", "b", 1e5), turning, *map(rf.Rigid, rigid)]
    reports = list(rf.simulate(rf.Scene(pair, MATERIAL, effects), 0.01, 0.5))
    names = "energy", "linear_momentum", "angular_momentum"
    lost = {name: drift(column(reports, name)) for name in names}
    show(**lost, springs=max(report.springs for report in reports))
    assert max(report.springs for report in reports) > 1e-3 * reports[0].energy
    assert max(lost.values()) <= 1e-11


@pytest.mark.parametrize("ends", own_spring.ENDS)
def test_the_spring_of_the_page(ends):
    """Energy and both momenta stay, whatever its ends are; it is stretched."""
    rows = np.array(own_spring.history(ends))
    assert np.abs(rows[:, 0] - rows[0, 0]).max() <= 1e-12 * rows[0, 0]
    assert np.abs(rows[:, 2:] - rows[0, 2:]).max() <= 1e-13 * np.abs(rows[0]).max()
    assert rows[:, 1].max() > 0.1 * rows[0, 0]


@pytest.mark.filterwarnings("ignore:Up to t:rigidfx.RigidfxWarning")  # it begins stretched
@pytest.mark.parametrize("end", ["x1", rf.MeanFace("x1")])
def test_the_spring_of_the_page_bends_a_reduced_part(end):
    """Its part had no shapes for it: the way erred by 19 %."""
    domain = rf.box((0, 0, 0), (1, 0.05, 0.02), (12, 2, 1))
    domain = domain.with_cells("bar", lambda x: x[0] > -1)
    domain = domain.with_facets("root", lambda x: x[0] < 0.084)
    spring = own_spring.OwnSpring(rf.MeanFace("root"), end, lambda q: 200.0 * (q - 0.9) ** 2)
    push = rf.Traction("x1", (0, 90, 300), time=lambda t: np.sin(21 * t) ** 2 * (t < 0.15))
    metal, tips = rf.StVenantKirchhoff(E=2e9, nu=0.3, rho=2000.0), []
    for part in ([], [rf.Reduced("bar")]):
        effects = [rf.Fixed("x0"), spring, push, *part]
        scene = rf.Scene(domain, metal, effects, element="enhanced", probes={"tip": (1, 0, 0)})
        tips.append(np.array([r.probes["tip"] for r in rf.simulate(scene, 2e-3, 0.2)]))
    assert np.abs(tips[1] - tips[0]).max() < 2e-3 * np.abs(tips[0]).max()


def test_the_spring_of_the_page_is_told_by_the_sets_that_it_joins():
    """Where its law fails, and where a set is unknown."""
    box = rf.box((0, 0, 0), (1, 1, 1), (2, 1, 1))
    with pytest.raises(rf.SceneError, match="OwnSpring on 'x0' and 'nowhere': there are no"):
        rf.Scene(box, MATERIAL, [own_spring.OwnSpring("x0", "nowhere", own_spring.energy)])
    scene = rf.Scene(box, MATERIAL, [own_spring.OwnSpring("x0", rf.MeanFace("x1"), lambda q: q.no)])
    with pytest.raises(rf.SceneError, match="OwnSpring on 'x0' and 'x1': its"):
        list(rf.simulate(scene, 0.1, 0.1))


def test_an_end_on_the_ground_needs_a_place():
    with pytest.raises(rf.SceneError, match="Own: its end on the ground needs a place"):
        end_of(rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (2, 1, 1)), MATERIAL), "Own", "ground")


def test_the_spring_of_the_page_in_statics_and_modes():
    """Its length under a pull, and the frequency of two masses that it joins, are exact."""
    assert own_spring.straining() == pytest.approx(1.0, rel=1e-4)  # with a weak spring beside it
    aside = (rf.Spring(name, (0.0, 1e6, 1e6)) for name in ("left", "right"))
    modes = rf.modes(own_spring.blocks("bodies", *aside), 1)
    wanted = np.sqrt(own_spring.K / 1000.0) / (2 * np.pi)  # each block has 2 t
    assert modes.frequencies[0] == pytest.approx(wanted, rel=1e-5)


def test_the_spring_of_the_page_goes_on_from_a_checkpoint(tmp_path):
    """It remembers its greatest length, and so does a run that goes on."""

    def scene():
        apart = rf.InitialVelocity(function=lambda x: (x[0] > 2.5) * [[1.0], [0.0], [0.0]])
        return own_spring.blocks("bodies", apart)

    def end(reports):
        *_, last = reports
        (longest,) = last.state.notes.values()
        return last.energy, last.springs, longest

    whole, cut = (rf.Checkpoint(tmp_path / name, steps=10) for name in ("whole", "cut"))
    whole = end(rf.simulate(scene(), 0.01, 0.3, checkpoint=whole))
    end(rf.simulate(scene(), 0.01, 0.2, checkpoint=cut))
    assert end(rf.resume(tmp_path / "cut", scene(), t_end=0.3)) == pytest.approx(whole, rel=1e-12)
    assert whole[2] > 1.05


@pytest.mark.parallel
def test_the_spring_of_the_page_on_two_ranks():
    rows = parallel.run(own_spring.__file__, 2, 120)
    alone = np.array(own_spring.history())
    assert np.abs(np.array(rows) - alone).max() <= 1e-9 * np.abs(alone).max()
