"""Input files of Abaqus and CalculiX: nodes, elements, sets, surfaces, parts and instances."""

import sys

import numpy as np
import pytest
import refusals
from histories import sizes
from mpi4py import MPI
from parallel import report as tell
from parallel import run as mpirun

import rigidfx as rf
from rigidfx.command.main import main
from rigidfx.domain.inp_mesh import faces_of

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its ranks itself")

# Three bricks in a row, of 10 mm each, with numbers that have gaps.
BAR = """\
*HEADING
 a bar, in mm
** nodes of four planes
*NODE, NSET=Nall
{nodes}
*Element, type=C3D8R, elset=EALL
 11, 1, 2, 3, 4, 101, 102, 103, 104
 12, 101, 102, 103, 104, 201, 202, 203, 204,
 15, 201, 202, 203, 204, 301,
 302, 303, 304
*ELSET, ELSET=soft, GENERATE
 11, 12, 1
*Elset, elset = "hard"
15,
*NSET, NSET=left
 1, 2, 3
 4
*Nset, nset=edge
101, 201
*NSET,NSET=both, UNSORTED
left, 304
*SURFACE, NAME=Right, TYPE=ELEMENT
hard, S2
*Surface, type=ELEMENT, name=under
eall, S3
*Surface, name=skin
soft,
*Surface, type=node, name=tip
 301,
 302,
*MATERIAL, NAME=STEEL
*ELASTIC
 210000, 0.3
*STEP
*STATIC
*BOUNDARY
left, 1, 3
*END STEP
"""
SQUARE = ((0, 0), (10, 0), (10, 10), (0, 10))
NODES = [
    f"{100 * k + n}, {10.0 * k}, {y}., {z}.0E0"
    for k in range(4)
    for n, (y, z) in enumerate(SQUARE, start=1)
]
BAR = BAR.format(nodes="\n".join(NODES))
SIZES = {
    ("EALL", 3): 3,
    ("soft", 3): 2,
    ("hard", 3): 1,
    ("Right", 2): 1,
    ("under", 2): 3,
    ("skin", 2): 9,
    ("left", 2): 1,
    ("edge", 0): 2,
    ("both", 0): 5,
    ("tip", 0): 2,
    ("Nall", 2): 14,
}


def written(folder, text, name="part.inp"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def middles(domain, name, dim):
    """Mean place of each entity of a set, in order."""
    from dolfinx.mesh import compute_midpoints

    x = compute_midpoints(domain.mesh, dim, domain.sets[name, dim].entities)
    return np.sort(x.round(12), axis=0).tolist()


def check_bar(domain):
    """Names, sizes and places."""
    assert sizes(domain) == SIZES
    x = domain.mesh.geometry.x
    np.testing.assert_allclose([x.min(axis=0), x.max(axis=0)], [[0, 0, 0], [0.03, 0.01, 0.01]])
    assert middles(domain, "hard", 3) == [[0.025, 0.005, 0.005]]
    assert middles(domain, "Right", 2) == [[0.03, 0.005, 0.005]]
    assert middles(domain, "left", 2) == [[0.0, 0.005, 0.005]]
    assert middles(domain, "under", 2) == [[k, 0.005, 0.0] for k in (0.005, 0.015, 0.025)]
    assert middles(domain, "edge", 0) == [[0.01, 0.0, 0.0], [0.02, 0.0, 0.0]]


def test_sets_and_surfaces(tmp_path):
    """Right sizes and places; small and capital letters, gaps, lines that go on, steps below."""
    check_bar(rf.read_inp(written(tmp_path, BAR), scale=1e-3))


def test_lines_of_other_systems(tmp_path):
    """Carriage returns, tabs, a mark of the encoding, exponents of Fortran."""
    text = "\ufeff" + BAR.replace(", ", ",\t").replace("0.0E0", "0.0D0").replace("\n", "\r\n")
    check_bar(rf.read_inp(written(tmp_path, text), scale=1e-3))


def test_a_file_that_includes_another(tmp_path):
    nodes, rest = BAR.split("*Element")
    written(tmp_path, nodes, "nodes.inc")
    check_bar(
        rf.read_inp(written(tmp_path, f"*INCLUDE, INPUT=nodes.inc\n*Element{rest}"), scale=1e-3)
    )


def test_faces_are_those_of_the_manuals():
    """S1 to S4 of tetrahedra and S1 to S6 of bricks: each face once, outwards or inwards alike."""
    assert [set(face) for face in faces_of("tetrahedron")] == [
        {0, 1, 2}, {0, 1, 3}, {1, 2, 3}, {0, 2, 3}
    ]  # fmt: skip
    assert [set(face) for face in faces_of("hexahedron")] == [
        {0, 1, 2, 3}, {4, 5, 6, 7}, {0, 1, 4, 5}, {1, 2, 5, 6}, {2, 3, 6, 7}, {0, 3, 4, 7}
    ]  # fmt: skip


PARTS = f"""\
*Part, name=Plate
*Node
{chr(10).join(NODES[:8])}
*Element, type=C3D8
 1, 1, 2, 3, 4, 101, 102, 103, 104
*Nset, nset=foot
 1, 2, 3, 4
*End Part
*Assembly, name=Assembly
*Instance, name=Plate-1, part=Plate
*End Instance
*Instance, name=Plate-2, part=plate
 50., 0., 0.
 50., 0., 0., 50., 0., 1., 90.
*End Instance
*Node
 1, 25., 0., 0.
*Nset, nset=held, instance=Plate-1
 1, 2, 3, 4
*Elset, elset=held, instance=Plate-1
 1,
*Elset, elset=_pushed_S2, internal, instance=Plate-2
 1,
*Surface, type=ELEMENT, name=pushed
_pushed_S2, S2
*Nset, nset=all, instance=Plate-2, generate
 1, 4
 101, 104
*Elset, elset=all, instance=Plate-2
 1
*End Assembly
"""


def test_parts_and_instances(tmp_path):
    """Placed, shifted and turned; sets by instances; a face is not the cells behind it."""
    domain = rf.read_inp(written(tmp_path, PARTS), scale=1e-3)
    assert sizes(domain) == {
        ("PLATE-1.foot", 2): 1,
        ("PLATE-2.foot", 2): 1,
        ("held", 2): 1,
        ("held (elements)", 3): 1,
        ("pushed", 2): 1,
        ("all", 3): 1,
    }
    assert middles(domain, "held", 2) == [[0.0, 0.005, 0.005]]
    assert middles(domain, "PLATE-2.foot", 2) == [[0.045, 0.0, 0.005]]
    assert middles(domain, "pushed", 2) == [[0.045, 0.01, 0.005]]


TETS = """\
*NODE
1, 0, 0, 0
2, 2, 0, 0
3, 0, 2, 0
4, 0, 0, 2
5, 1, 0, 0
6, 1, 1, 0
7, 0, 1, 0
8, 0, 0, 1
9, 1, 0, 1
10, 0, 1, 1
*ELEMENT, TYPE=C3D10
1, 1, 2, 3, 4, 5, 6, 7,
8, 9, 10
*NSET, NSET=bottom
1, 2, 3, 5, 6, 7
*SURFACE, NAME=slope
1, S3
"""


def test_cells_too_curved_are_read_by_their_corners(tmp_path):
    """As the error says."""
    path = written(tmp_path, TETS.replace("5, 1, 0, 0", "5, 1.7, 0.6, 0.2"))
    with pytest.raises(rf.SceneError, match=r"element 1: det J .* read_inp\(…, corners=True\)"):
        rf.read_inp(path)
    assert rf.read_inp(path, corners=True).mesh.geometry.x.shape == (4, 3)


def test_tetrahedra_of_ten_nodes(tmp_path):
    """A set with nodes on edges is the facet; by their corners cells are of first order."""
    path = written(tmp_path, TETS)
    for corners, nodes in ((False, 10), (True, 4)):
        domain = rf.read_inp(path, corners=corners)
        assert sizes(domain) == {("body", 3): 1, ("bottom", 2): 1, ("slope", 2): 1}
        assert len(domain.mesh.geometry.x) == nodes
        np.testing.assert_allclose(middles(domain, "slope", 2), [[2 / 3] * 3], rtol=1e-9)


def bricks_of_20():
    """One brick with a node on each edge."""
    ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
    corners = np.array([(*xy, z) for z in (0.0, 1.0) for xy in ring])
    low = [(k, (k + 1) % 4) for k in range(4)]
    edges = [*low, *((a + 4, b + 4) for a, b in low), *((k, k + 4) for k in range(4))]
    x = np.vstack([corners, [corners[[*edge]].mean(axis=0) for edge in edges]])
    lines = [f"{n}, {p[0]}, {p[1]}, {p[2]}" for n, p in enumerate(x, start=1)]
    numbers = ", ".join(map(str, range(1, 16))) + ",\n" + ", ".join(map(str, range(16, 21)))
    return "*NODE\n" + "\n".join(lines) + f"\n*ELEMENT, TYPE=C3D20R, ELSET=E\n1, {numbers}\n"


def test_bricks_of_twenty_nodes(tmp_path):
    path = written(tmp_path, bricks_of_20())
    with pytest.raises(rf.SceneError, match=r"1 of 20 nodes.*corners=True.*order=2"):
        rf.read_inp(path)
    domain = rf.read_inp(path, corners=True)
    assert sizes(domain) == {("E", 3): 1}
    assert len(domain.mesh.geometry.x) == 8


def test_lines_of_nodes(tmp_path):
    """Edges where the set has the nodes in their middles; a set of corners alone is vertices."""
    sets = {"line": "1, 2, 9", "bend": "1, 2, 3, 9, 10", "ends": "1, 2", "more": "1, 2, 7, 9"}
    found = {("line", 1): 1, ("bend", 1): 2, ("ends", 0): 2, ("more", 0): 3}
    text = "".join(f"*NSET, NSET={name}\n{nodes}\n" for name, nodes in sets.items())
    domain = rf.read_inp(written(tmp_path, bricks_of_20() + text), corners=True)
    assert sizes(domain) == {("E", 3): 1} | found
    assert middles(domain, "bend", 1) == [[0.5, 0.0, 0.0], [1.0, 0.5, 0.0]]
    held = rf.Scene(domain, rf.StVenantKirchhoff(E=1.0, nu=0.3, rho=1.0), order=2)
    assert [held.nodes(name, "test").size for name in sets] == [3, 5, 2, 3]
    path = written(tmp_path, f"{TETS}*NSET, NSET=side\n1, 4, 8\n")
    for corners in (False, True):
        domain = rf.read_inp(path, corners=corners)
        assert middles(domain, "side", 1) == [[0.0, 0.0, 1.0]]


def test_what_is_no_volume_is_told(tmp_path):
    """Quadrilaterals that bound cells are facets, as gmsh writes them; others are lost."""
    more = "*ELEMENT, TYPE=CPS4, ELSET=quads\n90, 1, 2, 3, 4\n91, 1, 2, 103, 104\n"
    more += "*ELSET, ELSET=one\n90\n"
    more += "*ELEMENT, TYPE=B31, ELSET=beam\n95, 1, 301\n"
    lost = "no volume cells are left out: 1 of B31, 1 of CPS4"
    with pytest.warns(rf.RigidfxWarning, match=lost):
        domain = rf.read_inp(written(tmp_path, BAR.replace("*MATERIAL", more + "*MATERIAL", 1)))
    assert sizes(domain) == SIZES | {("quads", 2): 1, ("one", 2): 1}


# What of the bar stands where another text leads to an error, that text, and the message.
WRONG = refusals.table(r"""
101, 201 >> 998, 999 :: no node 998, which 'edge' names
15,\n*NSET >> 16,\n*NSET :: no volume element 16
left, 304 >> lift, 304 :: no set 'LIFT', which 'both'
302, 303, 304\n*ELSET >> 302, 303, 304, 4\n*ELSET :: line 25.*element 15 has more than 8
302, 303, 304\n*ELSET >> 302\n*ELSET :: less than 8 nodes
101, 102, 103, 104\n 12 >> 101, 102, 103, 105\n 12 :: no node 105, which element 11
hard, S2 >> hard, S7 :: 'S7' is no face of these cells, which have S1 to S6
1, 0.0, 0., 0.0E0 >> 1, 0.0, zero, 0.0E0 :: line 5, .NODE: .* no finite numbers
2, 0.0, >> 1, 0.0, :: has node 1 at two places
 12, 101 >>  11, 101 :: has element 11 2 times
type=C3D8R,  >>  :: TYPE= is missing
C3D8R >> C3D6 :: more than 6 nodes
*ELSET, ELSET=soft >> *ELEMENT, TYPE=C3D4\n70, 1, 2, 3, 101\n*ELSET, ELSET=soft :: tetrahedra and he
C3D8R >> S8R :: no volume elements, such as C3D8
*ELSET, ELSET=soft >> *NGEN\n1, 2, 3\n*ELSET, ELSET=soft :: NGEN: cards that make nodes
*HEADING >> *INCLUDE, INPUT=none.inc\n*HEADING :: none.inc' cannot be read
*HEADING >> *INCLUDE, INPUT=part.inp\n*HEADING :: include each other without end
left, 304 >> both, 304 :: contains itself
 11, 12, 1\n >>  11\n :: GENERATE needs the first, the last
""")


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_read(tmp_path, case):
    """The message names the line, or the set."""
    before, after = case.replace("\\n", "\n").split(" >> ")
    assert before in BAR
    with pytest.raises(rf.SceneError, match=f"(?s){WRONG[case]}"):
        rf.read_inp(written(tmp_path, BAR.replace(before, after, 1)))


def test_bad_calls(tmp_path):
    (tmp_path / "binary.inp").write_bytes(b"*NODE\n\0\1")
    for call, message in (
        (lambda: rf.read_inp(tmp_path / "none.inp"), "There is no input file"),
        (lambda: rf.read_inp(tmp_path / "binary.inp"), "no text file"),
        (lambda: rf.read_inp(written(tmp_path, "")), "has no volume elements"),
        (lambda: rf.read_msh(written(tmp_path, BAR)), "take read_inp"),
    ):
        with pytest.raises(rf.SceneError, match=message):
            call()


def test_the_command_reads_them(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["rigidfx", str(written(tmp_path, TETS)), "--list"])
    with pytest.raises(SystemExit):
        main("rigidfx")
    assert "names: 'body' (cells), 'bottom' (facets), 'slope' (facets)" in capsys.readouterr().out


def test_the_command_gives_statics_modes_and_a_description(tmp_path, monkeypatch, capsys):
    """A tetrahedron that hangs: its weight is the reaction; no time of a run is asked for."""
    options = "--hold bottom --gravity 0 0 -9.81 --rho 1000 --static --modes 1 --describe"
    given = [str(written(tmp_path, TETS)), *options.split(), "--out", str(tmp_path / "out")]
    monkeypatch.setattr(sys, "argv", ["rigidfx", *given])
    summary = main("rigidfx")
    scene = rf.Scene(
        rf.read_inp(tmp_path / "part.inp"),
        rf.StVenantKirchhoff(rho=1000.0, E=2.1e11, nu=0.3),
        [rf.Fixed("bottom"), rf.Gravity((0, 0, -9.81))],
        order=2,
        mass="consistent",
    )
    told = capsys.readouterr().out
    assert "Scene of" in told
    weight = 9.81 * rf.modes(scene, 1).mass
    assert f"largest reaction of bottom: {weight:.4g} N" in told
    assert summary["frequencies"] == pytest.approx(rf.modes(scene, 1).frequencies.tolist())
    *_, last = rf.static(scene, 4, verbose=False)
    u = last.state.u.x.array.reshape(-1, 3)
    assert summary["largest_displacement"] == pytest.approx(np.linalg.norm(u, axis=1).max())
    assert (tmp_path / "out" / "stress.png").stat().st_size > 1000


@pytest.mark.parallel
def test_on_two_ranks(tmp_path):
    """The same sets; an error comes on both."""
    path = written(tmp_path, BAR)
    (found,) = mpirun(__file__, 2, 60, str(path))
    assert {tuple(key): count for key, count in found[0]} == SIZES
    assert found[1] == ["SceneError", "SceneError"]


if __name__ == "__main__":
    bar = rf.read_inp(sys.argv[1], scale=1e-3)
    counts = [[key, count] for key, count in sizes(bar).items()]
    try:
        rf.read_inp(sys.argv[1] + ".none")
    except rf.SceneError as error:
        kinds = MPI.COMM_WORLD.gather(type(error).__name__)
    tell([[counts, kinds]])
