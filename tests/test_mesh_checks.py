"""Warnings of meshes that give what nobody wanted: cells that lock, parts that only touch.

Run as a script under mpirun, this file reports what each case warns of.
"""

import re

import numpy as np
import parallel
import pytest
from common import on_first_rank
from histories import heard
from mpi4py import MPI

import rigidfx as rf

COMM = MPI.COMM_WORLD
SOFT = rf.StVenantKirchhoff(rho=1.0, E=100.0, nu=0.3)
CUBE = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], dtype=float)


def cubes(*corners):
    """A mesh of unit cubes, none of which shares a node with another."""
    if COMM.rank > 0:
        return rf.from_arrays(np.empty((0, 3)), np.empty((0, 8), dtype=np.int64))
    points = np.concatenate([CUBE + corner for corner in corners])
    return rf.from_arrays(points, np.arange(len(points)).reshape(-1, 8))


def end(domain, x, name="end"):
    return domain.with_facets(name, lambda X: np.abs(X[0] - x) < 1e-9)


def said(domain, *effects, order=1, mass="lumped", material=SOFT):
    """What a scene warns of."""
    with heard() as found:
        rf.Scene(domain, material, effects, order=order, mass=mass)
    return found


# (size, cells) of boxes, and what part of their deflection is left, where it is too little
BOXES = [
    ((1, 1, 1), (1, 1, 1), None),
    ((1, 1, 1), (2, 2, 2), None),
    ((4, 1, 1), (4, 1, 1), None),
    ((4, 2, 1), (8, 4, 2), None),
    ((10, 1, 1), (10, 1, 1), 0.67),
    ((10, 1, 1), (10, 2, 2), 0.65),
    ((10, 1, 1), (10, 3, 3), 0.65),
    ((10, 1, 1), (40, 4, 4), None),
    ((1, 1, 0.001), (10, 10, 1), 2e-4),
    ((1, 1, 0.001), (10, 10, 2), 2e-4),
    ((1, 1, 0.05), (10, 10, 1), 0.34),
]


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize(("size", "cells", "left"), BOXES)
def test_cells_that_lock_in_bending(size, cells, left, cell):
    """A 10:1 cantilever of cubes bends by 0.65 of theory, without a word."""
    found = said(rf.box((0, 0, 0), size, cells, cell))
    assert len(found) == (0 if left is None else 1)
    for message in found:
        assert "first-order cells lock in bending: the part of" in message
        estimate = float(re.search(r"leaves some (\S+) of its", message)[1])
        assert estimate < 1.1 * left
        assert estimate > 0.3 * left


@pytest.mark.parametrize("cells", [20, 40, 80])
def test_one_layer_of_cells_along_a_bar(cells):
    """Hexahedra leave 0.80, 0.85, 0.86 of a bar's deflection, and say nothing; tetrahedra 0.29."""
    bar = (0, 0, 0), (10, 1, 1), (cells, 1, 1)
    assert not said(rf.box(*bar))
    assert len(said(rf.box(*bar, "tetrahedron"))) == 1


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_rigid_parts_do_not_lock(cell):
    """Slender parts count without the cells that are rigid, which do not bend."""
    bar = rf.box((0, 0, 0), (20, 1, 1), (20, 1, 1), cell)
    arms = bar.with_cells("arms", lambda x: np.abs(x[0] - 10) > 0.9)
    tip = bar.with_cells("tip", lambda x: x[0] > 18.9)
    assert not said(arms, rf.Rigid("arms", each=True))
    assert "cells lock in bending" in said(tip, rf.Rigid("tip"))[0]
    rubber = rf.StVenantKirchhoff(rho=1.0, E=100.0, nu=0.495)
    parted = arms.with_cells("middle", lambda x: np.abs(x[0] - 10) < 1.1)
    for soft, found in (("arms", []), ("middle", ["lock at ν = 0.495"])):
        materials = {"arms": SOFT, "middle": SOFT, soft: rubber}
        shown = said(parted, rf.Rigid("arms", each=True), material=materials)
        assert len(shown) == len(found)
        assert all(words in shown[0] for words in found)


def test_second_order_cells_bend():
    assert not said(rf.box((0, 0, 0), (1, 1, 0.001), (10, 10, 1)), order=2)


def test_parts_that_touch_and_share_no_nodes():
    """The second cube would drift off from the first, which is held."""
    (message,) = said(end(cubes((0, 0, 0), (1, 0, 0)), 0), rf.Fixed("end"))
    assert "the part of 1 × 1 × 1 m around (1.5, 0.5, 0.5) m touches" in message
    assert "around (0.5, 0.5, 0.5) m, but they share no nodes" in message


# The least corner and the size of a second box, and whether it touches or overlaps a unit cube.
NEIGHBOURS = {
    "shifted": ((1, 0.3, 0.4), 1.0, True),
    "smaller": ((1, 0.2, 0.2), 0.5, True),
    "larger": ((1, -1, -1), 3.0, True),
    "overlapping": ((0.99, 0, 0), 1.0, True),
    "inside": ((0.3, 0.3, 0.3), 0.4, True),
    "far below the tolerance": ((1 + 1e-9, 0.3, 0.4), 1.0, True),
    "near": ((1.0001, 0.3, 0.4), 1.0, False),
    "near a corner": ((1.0001, 1.0001, 1.0001), 1.0, False),
}


def beside(corner, size):
    """The warning of a cube that is held and another one beside it."""
    boxes = np.concatenate([CUBE, CUBE * size + corner])
    domain = on_first_rank(boxes, np.arange(len(boxes)).reshape(-1, 8))
    return said(end(domain, 0), rf.Fixed("end"))


@pytest.mark.parametrize("name", NEIGHBOURS)
def test_parts_that_touch_where_nodes_do_not_match(name):
    corner, size, touches = NEIGHBOURS[name]
    assert [("touches, or overlaps, the part of" in m) for m in beside(corner, size)] == [
        True
    ] * touches


# Two long bars of one cell each, across each other: place and size of the second, and whether they
# touch. One without a width stands on its edge.
CROSSINGS = {
    "one on the other": ((0, 0, 1), (1, 9, 1), True),
    "one in the other": ((0, 0, 0.5), (1, 9, 1), True),
    "through the other": ((0.25, 0, 0.25), (0.5, 9, 0.5), True),
    "edge on face": ((0, 0, 1 + 1e-9), (0, 9, 0), True),
    "one above the other": ((0, 0, 1.001), (1, 9, 1), False),
}


def crossing(name):
    """The warning of a bar along x that is held, and of one along y that is not."""
    place, size, _ = CROSSINGS[name]
    first = CUBE * (9, 1, 1)
    turned = np.array([[1, 0, 1], [0, 1, 0], [-1, 0, 1]])  # a bar that stands on its edge
    unit = CUBE - (0.5, 0.5, 0.5)
    second = unit @ turned * (1, 9, 1) + (0, 0, 1) if size[0] == 0 else unit * size
    middle = (4.5, 0.5, place[2] + (size[2] / 2 if size[0] else 0))
    points = np.concatenate([first, second + middle])[: 16 if COMM.rank == 0 else 0]
    domain = rf.from_arrays(points, np.arange(len(points)).reshape(-1, 8))
    return [m for m in said(end(domain, 0), rf.Fixed("end")) if "lock" not in m]


@pytest.mark.parametrize("name", CROSSINGS)
def test_bars_that_cross_edge_over_edge(name):
    """No vertex and no middle of a face of either is near the other."""
    touches = CROSSINGS[name][2]
    assert ["touches, or overlaps, the part of" in m for m in crossing(name)] == [True] * touches


def test_three_parts_of_which_none_is_held():
    (message,) = said(cubes((0, 0, 0), (1, 0, 0), (2, 0, 0)))
    assert "In all, 3 parts touch like this." in message


def test_parts_that_do_not_fall_apart_are_no_news():
    """Free bodies apart, parts that a body joins, that a contact keeps apart, and one part."""
    apart, close = cubes((0, 0, 0), (2, 0, 0)), cubes((0, 0, 0), (1, 0, 0))
    assert not said(apart)
    assert not said(close, rf.Rigid(each=False))
    shifted = cubes((0, 0, 0), (1, 0.5, 0))
    sides = shifted.with_facets("left", lambda x: (np.abs(x[0] - 1) < 1e-9) & (x[1] < 1.2))
    sides = sides.with_facets("right", lambda x: (np.abs(x[0] - 1) < 1e-9) & (x[1] > 0.3))
    assert said(sides)
    assert not said(sides, rf.Contact("left", against="right"))
    assert not said(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)))


HELD = {"a support": rf.Fixed("b"), "a spring": rf.Spring("b", 1.0)}


@pytest.mark.parametrize("name", HELD)
def test_parts_that_touch_while_both_are_held(name):
    """The weld that is missing, or a contact: a load on one does not reach the other."""
    both = end(end(cubes((0, 0, 0), (1, 0, 0)), 0, "a"), 2, "b")
    (message,) = said(both, rf.Fixed("a"), HELD[name])
    assert "around (0.5, 0.5, 0.5) m touches, or overlaps, the part of 1 × 1 × 1 m" in message
    assert "no Contact is between them: they slide, part and overlap without" in message


@pytest.mark.parametrize(("away", "warns"), [(1e5, False), (1e8, True), (1e13, True)])
def test_a_mesh_far_from_the_origin(away, warns):
    """At 10¹⁵ lengths 2 % of the mass were gone."""
    found = said(rf.box((away, 0, 0), (away + 1, 1, 1), (2, 2, 2)))
    assert [("reaches" in m and "Move the mesh to the origin" in m) for m in found] == [
        True
    ] * warns


def test_describe_names_the_parts(capsys):
    text = rf.Scene(cubes((0, 0, 0), (2, 0, 0)), SOFT).describe()
    assert text.count("which shares no node with others") == 2
    assert (
        "node with others" not in rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), SOFT).describe()
    )


def test_a_rigid_name_in_several_pieces(capsys):
    """Three nuts of one name: one body, with a warning; a body each; or one body as meant."""
    free = cubes((0, 0, 0), (2, 0, 0), (4, 0, 0), (6, 0, 0)).with_cells("nut", lambda x: x[0] < 6)
    (message,) = said(free, rf.Rigid("nut"))
    assert "'nut': its cells are in 3 pieces, which move as one" in message
    assert not said(free, rf.Rigid("nut", each=False))
    for each, words, count in ((True, "a body each", 3), (False, "which move as one", 1)):
        assert not said(free, rf.Rigid("nut", each=each))
        scene = rf.Scene(free, SOFT, [rf.Rigid("nut", each=each)])
        assert f"Rigid 'nut': in 3 pieces, {words}" in scene.describe()
        first = next(rf.simulate(scene, 0.1, 0.1))
        assert [body.cells for body in first.bodies] == [3 // count] * count
    with pytest.raises(rf.SceneError, match="each must be True, False or None"):
        rf.Rigid("nut", each=2)
    taken = free.with_cells("nut 2", lambda x: x[0] > 5)
    with pytest.raises(rf.SceneError, match="there are cells of this name already"):
        rf.Scene(taken, SOFT, [rf.Rigid("nut", each=True)])


def test_each_nut_moves_on_its_own():
    """A nut that is held does not hold the others, which fall freely."""
    free = cubes((0, 0, 0), (2, 0, 0), (4, 0, 0)).with_cells("nut", lambda x: x[0] < 9)
    held = end(free, 0)
    effects = [rf.Fixed("end"), rf.Rigid("nut", each=True), rf.Gravity()]
    *_, last = rf.simulate(rf.Scene(held, SOFT, effects), 0.1, 0.2)
    assert last.clamped == ("nut 1",)
    assert [b.name for b in last.bodies] == ["nut 2", "nut 3"]
    assert [b.velocity[2] for b in last.bodies] == pytest.approx([-0.2 * 9.81] * 2, rel=1e-3)
    # A force on the common name would act on none of them.
    with pytest.raises(rf.SceneError, match="its 3 pieces are a body each"):
        rf.Scene(free, SOFT, [rf.Rigid("nut", each=True), rf.Resultant("nut", force=(1, 0, 0))])
    pushed = [rf.Rigid("nut", each=True), rf.Resultant("nut 2", force=(10, 0, 0))]
    *_, last = rf.simulate(rf.Scene(free, SOFT, pushed), 0.1, 0.2)
    assert last.linear_momentum[0] == pytest.approx(2.0, rel=1e-12)


# The corner at which a second unit cube begins, and the words for the nodes that it shares.
HINGES = {
    "an edge": ((1, 1, 0), "share 2 nodes of one edge around (1, 1, 0.5) m, and no facet"),
    "a corner": ((1, 1, 1), "share one node at (1, 1, 1) m, and no facet"),
    "another edge": ((1, 0, 1), "share 2 nodes of one edge around (1, 0.5, 1) m, and no facet"),
}


def hinged(corner, *effects):
    """The warnings of two unit cubes that share the nodes they have in common."""
    points, number = np.unique(np.concatenate([CUBE, CUBE + corner]), axis=0, return_inverse=True)
    cells = number.reshape(2, 8)
    domain = on_first_rank(points, cells).with_cells("first", lambda x: x[1] < 1.5)
    return said(end(domain.with_cells("both", lambda x: x[1] < 9), 0), *effects)


@pytest.mark.parametrize("name", HINGES)
def test_parts_that_share_an_edge_or_a_corner(name):
    """They would swing like a door; one rigid body of both does not."""
    corner, words = HINGES[name]
    (message,) = hinged(corner, rf.Fixed("end"))
    assert words in message
    assert "the part of 1 × 1 × 1 m around (0.5, 0.5, 0.5) m and" in message
    assert not hinged(corner, rf.Rigid("both"))


def _script():
    found = {}
    for cell in ("hexahedron", "tetrahedron"):
        for size, cells, _ in BOXES:
            found[f"{cell} {size} {cells}"] = said(rf.box((0, 0, 0), size, cells, cell))
        bar = rf.box((0, 0, 0), (20, 1, 1), (10, 1, 1), cell)
        bar = bar.with_cells("arm", lambda x: x[0] < 2.1)
        found[f"{cell} rigid"] = said(bar, rf.Rigid("arm"))
    found["touching"] = said(end(cubes((0, 0, 0), (1, 0, 0)), 0), rf.Fixed("end"))
    found["three"] = said(cubes((0, 0, 0), (1, 0, 0), (2, 0, 0)))
    for name, (corner, size, _) in NEIGHBOURS.items():
        found[name] = beside(corner, size)
    for name in CROSSINGS:
        found[name] = crossing(name)
    for name, (corner, _) in HINGES.items():
        found[f"hinge: {name}"] = hinged(corner, rf.Fixed("end"))
    nuts = cubes((0, 0, 0), (2, 0, 0), (4, 0, 0)).with_cells("nut", lambda x: x[0] < 3)
    found["nuts"] = said(nuts, rf.Rigid("nut"))
    each = rf.Scene(nuts, SOFT, [rf.Rigid("nut", each=True)])
    found["each"] = [b.name for b in next(rf.simulate(each, 0.1, 0.1)).bodies]
    found["apart"] = said(cubes((0, 0, 0), (2, 0, 0)))
    bar = rf.box((0, 0, 0), (10, 1, 1), (10, 1, 1))
    spin = rf.InitialVelocity(angular=(1.0, 0, 0))
    body = next(rf.simulate(rf.Scene(bar, SOFT, [rf.Rigid(), spin]), 0.1, 0.1)).bodies[0]
    found["ratio"] = round(body.inertia_ratio, 10)
    found["far"] = said(rf.box((1e9, 0, 0), (1e9 + 1, 1, 1), (2, 2, 2)))
    parallel.report(found)


@pytest.mark.parallel
def test_ranks_say_the_same():
    one, three = (parallel.run(__file__, n, timeout=300) for n in (1, 3))
    assert one["ratio"] == 3.0
    assert len(one["touching"]) == 1
    assert one == three


if __name__ == "__main__":
    _script()
