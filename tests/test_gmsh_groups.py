"""Physical groups of gmsh's files and scripts: what they hold, and what is told of the rest."""

import re

import numpy as np
import pytest
from cad import session
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.errors import RigidfxWarning, SceneError

pytest.importorskip("gmsh")
pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="writes files")

TWO = """SetFactory("OpenCASCADE");
Mesh.MeshSizeMax = 0.5;
Box(1) = {0, 0, 0, 1, 1, 1};
Box(2) = {1, 0, 0, 1, 1, 1};
BooleanFragments{ Volume{1}; Delete; }{ Volume{2}; Delete; }
"""
NAMES = """Physical Volume("one") = {1};
Physical Volume("two") = {2};
Physical Surface("left") = Surface In BoundingBox {-0.1, -1, -1, 0.1, 2, 2};
Physical Surface("right") = Surface In BoundingBox {1.9, -1, -1, 2.1, 2, 2};
Physical Point("tip") = Point In BoundingBox {1.9, 0.9, 0.9, 2.1, 1.1, 1.1};
"""


@pytest.fixture
def script(tmp_path):
    """Writes a script of two boxes side by side with some more lines, and gives its path."""

    def write(*lines):
        path = tmp_path / "two.geo"
        path.write_text(TWO + "\n".join(lines))
        return path

    return write


@pytest.fixture
def saved(script, tmp_path):
    """Meshes such a script and saves it in a version of the format."""

    def save(version, *lines, dim=3, suffix="msh"):
        path = tmp_path / f"{version}.{suffix}"
        with session(MshFileVersion=version) as gmsh:
            gmsh.open(str(script(*lines)))
            gmsh.model.mesh.generate(dim)
            gmsh.write(str(path))
        return path

    return save


def counts(domain):
    return {name: domain.count(entities) for (name, _), entities in domain.sets.items()}


def with_one_entity(path, number):
    """The file as converters write it that know groups only: one elementary number for all."""
    lines = path.read_text().splitlines()
    start, end = lines.index("$Elements") + 2, lines.index("$EndElements")
    for k in range(start, end):
        words = lines[k].split()
        lines[k] = " ".join([*words[:4], str(number), *words[5:]])
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("number", [0, 1])
def test_groups_without_entities_of_their_own(saved, number):
    """A support of "left" clamped both ends, as each group held the facets of all."""
    path = saved(2.2, NAMES)
    found = counts(rf.read_msh(path))
    assert 0 < found["left"] == found["right"] < found["one"]
    assert counts(rf.read_msh(with_one_entity(path, number))) == found
    domain = rf.read_msh(path)
    domain.mesh.topology.create_connectivity(2, 0)
    corners = domain.mesh.topology.connectivity(2, 0)
    points = domain.mesh.geometry.x[
        np.concatenate([corners.links(f) for f in domain.sets["left", 2].entities])
    ]
    assert points[:, 0].max() == 0.0


def test_groups_that_overlap_need_entities(saved):
    """Which of the cells that are there once are in both, no file of this kind says."""
    path = saved(2.2, NAMES, 'Physical Volume("both") = {1, 2};')
    assert counts(rf.read_msh(path))["both"] > counts(rf.read_msh(path))["one"]
    with pytest.raises(SceneError, match=r"one elementary number .*version 4\.1"):
        rf.read_msh(with_one_entity(path, 1))


@pytest.mark.parametrize("save_all", [0, 1])
def test_cells_outside_all_groups_are_told(script, saved, save_all):
    """And a script that saves all ended all ranks."""
    lines = f"Mesh.SaveAll = {save_all};", 'Physical Volume("one") = {1};'
    told = r"\d+ volume cells are in no physical group and are"
    for read, path in ((rf.read_geo, script(*lines)), (rf.read_msh, saved(4.1, *lines))):
        if read is rf.read_msh and not save_all:
            continue  # gmsh does not write them then
        with pytest.warns(RigidfxWarning, match=told):
            domain = read(path)
        assert counts(domain)["one"] == domain.mesh.topology.index_map(3).size_global
        assert domain.mesh.geometry.x[:, 0].max() == 1.0


def test_without_any_group_all_is_body(script, saved):
    for domain in (rf.read_geo(script()), rf.read_msh(saved(4.1, "Mesh.SaveAll = 1;"))):
        assert counts(domain) == {"body": domain.mesh.topology.index_map(3).size_global}


@pytest.mark.parametrize("kind", ["unv", "med", "cgns", "bdf", "nas", "vtk", "mesh"])
def test_meshes_of_other_programs(saved, kind):
    """Names are kept where gmsh reads them; volumes are parts where the format has no names."""
    if kind == "unv":
        with pytest.raises(SceneError, match=r"'tip' names element [0-9]+, which is not in the fi"):
            rf.read_msh(path := saved(4.1, NAMES, suffix=kind))
        path.write_text(path.read_text()[:9000])
        with pytest.raises(SceneError, match="is damaged: its last data set breaks off"):
            rf.read_msh(path)
    names = NAMES if kind == "med" else NAMES.rsplit("Physical", 1)[0]
    try:
        domain = rf.read_msh(saved(4.1, names, suffix=kind), scale=1e-3)
    except Exception as error:
        if re.search("must be compiled with", str(error)):
            pytest.skip(str(error))
        raise
    found = counts(domain)
    assert domain.mesh.geometry.x[:, 0].max() == pytest.approx(2e-3)
    total = domain.mesh.topology.index_map(3).size_global
    if kind in ("unv", "med", "cgns"):
        assert {*found} >= {"one", "two", "left", "right"}
        assert found["one"] + found["two"] == total
        assert found["left"] > 5
    else:
        assert sum(found.values()) == total
        assert {*found} in ({"part 1", "part 2"}, {"body"})  # .vtk has one volume only


FACES = 'Physical Surface("left") = {1};'


@pytest.mark.parametrize(
    ("read", "told"),
    [
        (lambda script, saved: rf.read_geo(script(FACES)), r'Volume\("body"\) = {1, 2};.*\'left\''),
        (
            lambda script, saved: rf.read_geo(script(FACES, 'Physical Volume("no") = {};')),
            r"That of 'no' holds none; to name .*\"body\"\) = {1, 2};",
        ),
        (
            lambda script, saved: rf.read_geo(script("Delete { Volume{1, 2}; }", FACES)),
            "There is no volume at all, only 11 surfaces",
        ),
        (lambda script, saved: rf.read_msh(saved(4.1, NAMES, dim=2)), "in 3D before .gmsh -3"),
    ],
)
def test_why_there_are_no_cells(script, saved, read, told):
    """What to do depends on what there is instead."""
    with pytest.raises(SceneError, match=f"no physical group of volume cells.*{told}"):
        read(script, saved)
