"""Two names of a file never become one: encodings, capitals, blanks, slashes, kinds of sets."""

import re

import pytest
from cad import saved
from histories import sizes
from mpi4py import MPI

import rigidfx as rf

alone = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="writes files")

# Two bricks, one beside the other along x.
BRICKS = "*NODE\n" + "".join(
    f"{100 * k + n}, {k}, {y}, {z}\n"
    for k in range(3)
    for n, (y, z) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1)), start=1)
)
BRICKS += (
    "*ELEMENT, TYPE=C3D8\n1, 1, 2, 3, 4, 101, 102, 103, 104\n"
    "2, 101, 102, 103, 104, 201, 202, 203, 204\n"
)
ENDS = "*NSET, NSET={0}\n1, 2, 3, 4\n*NSET, NSET={1}\n201, 202, 203, 204\n"
HALVES = "*ELSET, ELSET={2}\n1\n*ELSET, ELSET={3}\n2\n"


@alone
@pytest.mark.parametrize(
    ("names", "written", "given"),
    [
        (("Fläche", "Flüche", "Körper", "Kürper"), "latin-1", None),
        (("Fläche–1", "Fläche—1", "€", "Ž"), "cp1252", None),
        (("Maß", "MASS", "ﬁn", "FIN"), "utf-8", None),
        (("固定端", "固定面", "钢", "铝"), "gb18030", "gb18030"),
        (("固定端", "固定面", "钢", "铝"), "utf-16", "utf-16"),
        (("固定端", "固定面", "钢", "铝"), "utf-8-sig", None),
    ],
)
def test_encodings(tmp_path, recwarn, names, written, given):
    """Names are told in a warning where the encoding is a guess."""
    path = tmp_path / "part.inp"
    path.write_bytes((BRICKS + (ENDS + HALVES).format(*names)).encode(written))
    guessed = written in ("latin-1", "cp1252")
    if guessed:
        with pytest.warns(rf.RigidfxWarning, match=f"not in UTF-8.*'{names[2]}'.*encoding="):
            part = rf.read_inp(path)
    else:
        part = rf.read_inp(path, encoding=given)
    dims = (2, 2, 3, 3)
    assert sizes(part) == dict.fromkeys(zip(names, dims, strict=True), 1)


@alone
def test_letters_of_an_encoding_that_is_not_known(tmp_path):
    """GB18030 read as Latin-1: names are odd, but as many as there are.

    The second bytes of 疉 and 痑 differ as a capital and a small letter do. The first byte of 丂
    has no letter in cp1252, and 0x85 is a line end in Latin-1.
    """
    names = bytes.fromhex("af41"), bytes.fromhex("af61"), "丂".encode("gb18030"), b"\x85\x85"
    text = (BRICKS + (ENDS + HALVES)).encode()
    for k, name in enumerate(names):
        text = text.replace(b"{%d}" % k, name)
    (tmp_path / "part.inp").write_bytes(text)
    with pytest.warns(rf.RigidfxWarning, match=r"\(in gb18030: .*encoding='gb18030'"):
        part = rf.read_inp(tmp_path / "part.inp")
    assert sorted(sizes(part).values()) == [1, 1, 1, 1]
    assert sorted(dim for _, dim in sizes(part)) == [2, 2, 3, 3]
    for encoding, match in (("ascii", "ordinal not in range"), ("klingon", "unknown encoding")):
        with pytest.raises(rf.SceneError, match=match):
            rf.read_inp(tmp_path / "part.inp", encoding=encoding)


@alone
def test_one_name_for_sets_of_two_kinds(tmp_path):
    """A surface and a set of nodes are one name only if they are the same facets."""
    ends = BRICKS + ENDS.format("end", "far")
    ends += "*SURFACE, NAME=far\n2, S2\n*SURFACE, NAME=end\n2, S2\n"
    (tmp_path / "part.inp").write_text(ends)
    part = rf.read_inp(tmp_path / "part.inp")
    assert sizes(part) == {("body", 3): 2} | {(n, 2): 1 for n in ("end", "end (nodes)", "far")}
    part_twice = "*PART, NAME=p\n*END PART\n*PART, NAME=P\n*END PART\n"
    (tmp_path / "part.inp").write_text(part_twice)
    with pytest.raises(rf.SceneError, match=r"line 3.*there is a part 'P' before it"):
        rf.read_inp(tmp_path / "part.inp")


def groups_of(path, names):
    """Write a mesh file with four faces of a box as groups."""

    def build(model):
        body = model.occ.addBox(0, 0, 0, 1, 1, 1)
        model.occ.synchronize()
        model.addPhysicalGroup(3, [body], name="body")
        for tag, name in enumerate(names, start=1):
            model.addPhysicalGroup(2, [tag], name=name)
        model.mesh.generate(3)

    version = 2.2 if "old" in path.name else 4.1
    saved(path, build, MeshSizeMax=1, MshFileVersion=version, SaveGroupsOfElements=1)


@alone
@pytest.mark.parametrize("name", ["old.msh", "new.msh", "part.unv"])
def test_groups_of_gmsh(tmp_path, name):
    """Latin-1 had ended in a UnicodeDecodeError; a blank at the end of a name was refused."""
    names = ["Fläche", "Flüche", "top", "top_" if name.endswith("unv") else "top "]
    path = tmp_path / name
    groups_of(path, names)
    for data in (path.read_bytes(), path.read_bytes().decode().encode("latin-1")):
        path.write_bytes(data)
        part = rf.read_msh(path)
        assert {name for name, dim in part.sets if dim == 2} == set(names)


@pytest.fixture(scope="module")
def three(tmp_path_factory):
    """Three boxes apart, as the text of a STEP file."""
    path = tmp_path_factory.mktemp("cad") / "three.step"

    def build(model):
        for k in range(3):
            model.occ.addBox(2 * k, 0, 0, 1, 1, 1)
        model.occ.synchronize()

    saved(path, build)
    text = path.read_text()
    whole, *parts = re.findall(r"\bPRODUCT\s*\(\s*'([^']*)'", text)  # OpenCASCADE counts its files
    for number, name in enumerate(parts, start=1):
        text = text.replace(f"'{name}'", f"'all/1.{number}'")
    return text.replace(f"'{whole}'", "'all/1'")


@alone
@pytest.mark.parametrize(
    ("names", "encoding", "escaped"),
    [
        (("M8/20", "M6/20", "M6/20 "), "utf-8", {}),
        (("Fläche", "Flüche", "Blö/cke"), "latin-1", {}),
        (
            ("Fläche", "Flüche", "Blö/cke"),
            "ascii",
            {"ä": r"\X\E4", "ü": r"\S\|", "ö": r"\X2\00F6\X0\ "},
        ),
        (("it's/2", "面/一", "/面"), "utf-8", {"'": "''"}),
    ],
)
def test_labels_of_step(tmp_path, three, names, encoding, escaped):
    """A label was what follows the last slash, and OpenCASCADE takes letters together."""
    text = three
    for k, name in enumerate(names, start=1):
        for letter, other in escaped.items():
            name = name.replace(letter, other.strip())
        text = text.replace(f"all/1.{k}", name)
    path = tmp_path / "three.step"
    path.write_bytes(text.encode(encoding))
    assert [v.label for v in rf.list_cad(path).volumes] == list(names)
    part = rf.read_cad(path, volumes={"first": names[0]}, size=2e-3)
    assert {name for name, _ in part.sets} == {"first", *names}
