"""Right decks of Abaqus and CalculiX that were refused, and wedges that look like bricks."""

import re
import warnings

import numpy as np
import pytest
import ufl
from basix.ufl import element
from elements import Forces
from histories import sizes
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.compat import create_mesh
from rigidfx.domain.cell_quality import volume

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="writes files")

NODES = """\
*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
11, 0, 0, 1
12, 1, 0, 1
13, 1, 1, 1
14, 0, 1, 1
21, 0.5, 0, 0
22, 1, 0.5, 0
23, 0.5, 0.5, 0
"""
BRICK = "*ELEMENT, TYPE=C3D8, ELSET=brick\n1, 1, 2, 3, 4, 11, 12, 13, 14\n"
TET = "*ELEMENT, TYPE=C3D4, ELSET=tet\n1, 1, 2, 3, 11\n"


def read(folder, text):
    (folder / "part.inp").write_text(text)
    return rf.read_inp(folder / "part.inp")


@pytest.mark.parametrize(
    ("cells", "flat", "left"),
    [
        (BRICK, "S3, ELSET=lid\n5, 1, 2, 3\n", "1 of S3"),
        (BRICK, "S6, ELSET=lid\n5, 1, 2, 3, 21, 22, 23\n", "1 of S6"),
        (BRICK, "M3D3, ELSET=lid\n5, 1, 2, 3\n", "1 of M3D3"),
        (BRICK, "T3D2, ELSET=lid\n5, 1, 2\n", "1 of T3D2"),
        (TET, "R3D4, ELSET=lid\n5, 1, 2, 3, 4\n", "1 of R3D4"),
        (TET, "S4, ELSET=lid\n5, 1, 2, 3, 4\n6, 11, 12, 13, 14\n", "2 of S4"),
    ],
)
def test_shells_beside_other_cells(tmp_path, cells, flat, left):
    """Their faces are none of the cells'; this ended in NumPy's words."""
    with pytest.warns(rf.RigidfxWarning, match=f"left out: {left}"):
        part = read(tmp_path, NODES + cells + "*ELEMENT, TYPE=" + flat)
    assert list(sizes(part)) == [("brick" if cells == BRICK else "tet", 3)]
    assert volume(part.mesh) == pytest.approx(1.0 if cells == BRICK else 1 / 6)


def test_sets_of_nothing_are_told_with_elements_left_out(tmp_path):
    """Of nodes beside the cells, and surfaces of shells, too; in one warning."""
    more = "S3, ELSET=lid\n5, 1, 2, 3\n*SURFACE, NAME=skin\nlid, SPOS\n*NSET, NSET=pilot\n23\n"
    with pytest.warns(rf.RigidfxWarning) as told:
        part = read(tmp_path, NODES + BRICK + "*ELEMENT, TYPE=" + more)
    assert list(sizes(part)) == [("brick", 3)]
    (message,) = (str(each.message) for each in told)
    assert "left out: 1 of S3." in message
    assert message.endswith("or corner of one, are left out: 'lid', 'skin', 'pilot'.")


def test_messages_have_numbers_of_the_deck(tmp_path):
    """Not those of rows, from 0; with the instance where there are some."""
    square = "0, 0", "1, 0", "1, 1", "0, 1"
    above = [f"{10 * z + 11 + k}, {square[k]}, {z}" for z in (2, 3) for k in range(4)]
    mesh = "\n".join([NODES.rstrip(), *above, "*ELEMENT, TYPE=C3D8, ELSET=brick", ""])
    mesh += "3, 11, 12, 13, 14, 31, 32, 33, 34\n4, 31, 32, 33, 34, 41, 42, 43, 44\n"
    inverted = "7, 11, 12, 13, 14, 1, 2, 3, 4\n"
    with pytest.raises(rf.SceneError, match=r"around \(0.5, 0.5, 0.5\) m, element 7: det J"):
        read(tmp_path, mesh + inverted)
    with pytest.raises(rf.SceneError, match="has element 3 and element 9 with the same nodes"):
        read(tmp_path, mesh + "9, 12, 13, 14, 11, 32, 33, 34, 31\n")
    parts = f"*PART, NAME=A\n{NODES + BRICK}*END PART\n*PART, NAME=B\n{mesh + inverted}"
    placed = "*END PART\n*INSTANCE, NAME=one, PART=A\n*END INSTANCE\n*INSTANCE, NAME=two, PART=B\n"
    with pytest.raises(rf.SceneError, match="element 7 of instance 'TWO'"):
        read(tmp_path, parts + placed + "3, 0, 0\n*END INSTANCE\n")


@pytest.mark.parametrize("numbers", ["1, 9, 2, 7", "1, , 9", "1, 9, 0", "9", "1, 9, 2, x"])
def test_generate_of_other_numbers(tmp_path, numbers):
    """None is passed over."""
    with pytest.raises(rf.SceneError, match=r"line 16, \*NSET: (GENERATE needs|.* whole numbers)"):
        read(tmp_path, NODES + BRICK + f"*NSET, NSET=low, GENERATE\n{numbers}\n")


def test_what_calculix_passes_over(tmp_path):
    """Lines before the first card, and nodes too many in the line of an element: it says so."""
    text = ">**\n" + NODES + BRICK.replace("13, 14\n", "13, 14, 21, 22,\n")
    with pytest.warns(rf.RigidfxWarning) as told:
        part = read(tmp_path, text)
    assert sizes(part) == {("brick", 3): 1}
    assert volume(part.mesh) == pytest.approx(1.0)
    first, second = (str(each.message) for each in told)
    assert "line 1 of" in first
    assert first.endswith("before the first card, and is passed over: '>**'.")
    assert "line 14, *ELEMENT: lines, the first of element 1, have more nodes than the 8" in second
    with pytest.raises(rf.SceneError, match="line 1: data without a card"):
        read(tmp_path, "1, 0, 0, 0\n2, 1, 0, 0\n")


def test_shells_that_fit(tmp_path):
    """Triangles are facets of tetrahedra, membranes of bricks."""
    for flat in ("S3, ELSET=lid\n5, 1, 2, 3\n", "STRI3, ELSET=lid\n5, 3, 2, 1\n"):
        part = read(tmp_path, NODES + TET + "*ELEMENT, TYPE=" + flat)
        assert sizes(part) == {("tet", 3): 1, ("lid", 2): 1}
    part = read(tmp_path, NODES + BRICK + "*ELEMENT, TYPE=M3D4R, ELSET=lid\n5, 1, 2, 3, 4\n")
    assert sizes(part) == {("brick", 3): 1, ("lid", 2): 1}


def test_generate_over_numbers_that_are_not_there(tmp_path):
    """Those that are there count; at least one has to be."""
    ranges = (
        "*NSET, NSET=low, GENERATE\n1, 9\n*NSET, NSET=top, GENERATE\n10, 2000000000\n"
        "*NSET, NSET=odd, GENERATE\n1, 13, 2\n*ELSET, ELSET=all, GENERATE\n1, 100\n"
    )
    part = read(tmp_path, NODES + BRICK + ranges)
    assert sizes(part) == {
        ("brick", 3): 1,
        ("all", 3): 1,
        ("low", 2): 1,
        ("top", 2): 1,
        ("odd", 0): 4,
    }
    for text, match in (
        ("*NSET, NSET=a, GENERATE\n100, 200\n", "has no node 100, which 'a' names"),
        ("*NSET, NSET=a, GENERATE\n9, 1\n", "GENERATE needs"),
        ("*NSET, NSET=a\n9, 77\n", "has no node 9, which 'a' names"),
    ):
        with pytest.raises(rf.SceneError, match=match):
            read(tmp_path, NODES + BRICK + text)


def test_numbers_that_are_not_there(tmp_path):
    """They are told, as by CalculiX, if a set has others."""
    text = "*NSET, NSET=low\n1, 2, 3, 4, 9, 77\n*ELSET, ELSET=one\n1\n"
    text += "*ELSET, ELSET=two, GENERATE\n1, 1\n5, 7\n"
    with pytest.warns(rf.RigidfxWarning) as told:
        part = read(tmp_path, NODES + BRICK + text)
    assert sizes(part) == {("brick", 3): 1, ("one", 3): 1, ("two", 3): 1, ("low", 2): 1}
    (only,) = told
    assert str(only.message).endswith("volume element 5, and are read without them: 'two', 'low'.")


def test_data_of_other_files_and_groups(tmp_path):
    """Data lines of an included file, nodes of elements, surfaces of surfaces, a node once more."""
    (tmp_path / "more.nod").write_text("** the rest\n" + NODES.partition("\n")[2])
    first = NODES.splitlines()[1]
    text = f"*NODE, NSET=every,\n*INCLUDE, INPUT=more.nod\n{first}\n{BRICK}"
    text += "*NSET, NSET=corners, ELSET=brick\n*SURFACE, NAME=low\n1, S1\n"
    text += "*SURFACE, NAME=side\n1, S3\n*SURFACE, NAME=l, COMBINE=UNION\nlow, SIDE\n"
    part = read(tmp_path, text)
    assert sizes(part) == {
        ("brick", 3): 1,
        ("low", 2): 1,
        ("side", 2): 1,
        ("l", 2): 2,
        ("corners", 2): 6,
        ("every", 2): 6,
    }
    for more, match in (
        ("*SURFACE, NAME=d, COMBINE=DIFFERENCE\nlow\n", "COMBINE=DIFFERENCE is not read"),
        ("*SURFACE, NAME=d, COMBINE=UNION\nd\n", "surface 'd' that contains itself"),
        ("*NSET, NSET=d, ELSET=none\n", "no set 'NONE', which 'd' names"),
        ("*NODE\n1, 5, 5, 5\n", "node 1 at two places"),
    ):
        with pytest.raises(rf.SceneError, match=match):
            read(tmp_path, text + more)
    (tmp_path / "more.nod").write_text("1, 0, 0, 0\n\n2, x\n")
    with pytest.raises(rf.SceneError, match=r"more.nod', line 3, \*NODE: 'x' are no finite"):
        read(tmp_path, text)


def test_commas_and_dots_in_names(tmp_path):
    """Quotes keep commas; a dot need not divide an instance from its set."""
    names = (
        '*NSET, NSET="low, left"\n1, 2, 3, 4\n*NSET, NSET=V1.2\n11, 12, 13, 14\n'
        '*NSET, NSET=some\n"low, left", 11\n*NSET, NSET=more\nV1.2, 1\n'
        '*ELSET, ELSET="a, b.c"\n1\n*SURFACE, NAME="side, right"\n"a, b.c", S2\n'
    )
    part = read(tmp_path, NODES + BRICK + names)
    assert sizes(part) == {
        ("brick", 3): 1,
        ("a, b.c", 3): 1,
        ("side, right", 2): 1,
        ("low, left", 2): 1,
        ("V1.2", 2): 1,
        ("some", 0): 5,
        ("more", 0): 5,
    }


# Seven bricks: MacNeal and Harder, Finite Elements in Analysis and Design 1 (1985), 3-20.
INNER = [
    (0.249, 0.342, 0.192), (0.826, 0.288, 0.288), (0.850, 0.649, 0.263), (0.273, 0.750, 0.230),
    (0.320, 0.186, 0.643), (0.677, 0.305, 0.683), (0.788, 0.693, 0.644), (0.165, 0.745, 0.702),
]  # fmt: skip
OUTER = [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
FACES = [(0, 1, 2, 3), (5, 4, 7, 6), (1, 0, 4, 5), (2, 1, 5, 6), (3, 2, 6, 7), (0, 3, 7, 4)]


def patch():
    """The deck."""
    nodes = [f"{n}, {x}, {y}, {z}" for n, (x, y, z) in enumerate(OUTER + INNER, start=1)]
    bricks = [range(8, 16), *([*face, *(8 + n for n in face)] for face in FACES)]
    lines = [", ".join(map(str, (k, *(n + 1 for n in b)))) for k, b in enumerate(bricks, start=1)]
    return "\n".join(["*NODE", *nodes, "*ELEMENT, TYPE=C3D8", *lines]) + "\n"


@pytest.mark.parametrize("options", [{}, {"element": "enhanced"}, {"order": 2}])
def test_patch_of_seven_bricks(tmp_path, options):
    """One corner has det J < 0. A constant strain is exact nevertheless, and so is the volume."""
    with pytest.warns(rf.RigidfxWarning, match="1 cells are inside out or flat at a corner"):
        part = read(tmp_path, patch())
    assert volume(part.mesh) == pytest.approx(1.0, rel=1e-12)
    scene = rf.Scene(part, rf.StVenantKirchhoff(E=1e6, nu=0.25, rho=1.0), **options)
    X = scene.space.tabulate_dof_coordinates()
    f = Forces(scene).at(X @ np.array([[2e-3, 1e-3, 0], [1e-3, 1e-3, 2e-3], [0, 1e-3, -1e-3]]).T)
    inside = ((X > 1e-9) & (X < 1 - 1e-9)).all(axis=1).repeat(3)
    assert inside.any()
    assert np.abs(f[inside]).max() < 1e-12 * np.abs(f).max()


@pytest.mark.parametrize(
    ("nodes", "shape"),
    [
        ("1, 2, 3, 3, 11, 12, 13, 13", "names node 3 2 times: it is a wedge"),
        ("1, 2, 3, 4, 11, 11, 11, 11", "names node 11 4 times: it is a pyramid"),
        ("1, 2, 3, 3, 11, 11, 11, 11", "names node 11 4 times: it is a tetrahedron"),
        ("1, 2, 3, 4, 11, 12, 13, 13", "names node 13 2 times: it is a brick with an edge of no l"),
    ],
)
def test_bricks_with_a_node_twice(tmp_path, nodes, shape):
    """Their shape is told, by the deck's numbers, or by those of arrays."""
    with pytest.raises(rf.SceneError, match=f"element 7 of type C3D8, which {shape}.*Wedges and"):
        read(tmp_path, NODES + "*ELEMENT, TYPE=C3D8\n7, " + nodes)
    rows = [[int(n) for n in re.findall(r"\d+", nodes)]]
    with pytest.raises(rf.SceneError, match=f"from_arrays: cell 0 {shape}"):
        rf.from_arrays(np.random.default_rng(0).random((20, 3)), rows)


def test_a_wedge_in_a_mesh_of_dolfinx(tmp_path):
    """As a file of gmsh may have it, too."""
    x, rows = np.array(OUTER, dtype=float), np.array([[0, 1, 2, 2, 4, 5, 6, 6]])
    mesh = create_mesh(
        MPI.COMM_SELF, rows, x, ufl.Mesh(element("Lagrange", "hexahedron", 1, shape=(3,)))
    )
    with pytest.raises(rf.SceneError, match="Cell 0 of the input names node 2 2 times: it is a we"):
        rf.Domain(mesh)


def test_sound_cells_are_silent():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rf.from_arrays(np.array(OUTER, dtype=float), [list(range(8))])
