"""Geometry that is meshed when it is read: scripts of gmsh, CAD; and what all readers refuse.

Run as a script under mpirun, this file runs an adaptive scene on a script's mesh, and reads what
cannot be read.
"""

import re
import warnings
from pathlib import Path

import numpy as np
import parallel
import pytest
from cad import saved
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.base.errors import SceneError

gmsh = pytest.importorskip("gmsh")

BRACKET = Path(__file__).resolve().parent.parent / "meshes" / "bracket.geo"
alone = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="writes files")


def volume(domain, cells=None):
    """Of a domain of straight or curved cells, by the mass of a scene with density 1 [m³]."""
    order = 2 if len(cell_geometry_dofs(domain.mesh)[0]) > 8 else 1
    material = rf.StVenantKirchhoff(E=1.0, nu=0.3, rho=1.0)
    if cells is not None:
        rest = rf.StVenantKirchhoff(E=1.0, nu=0.3, rho=1e-12)
        others = [name for name, dim in domain.sets if dim == 3 and name != cells]
        material = {cells: material} | dict.fromkeys(others, rest)
    scene = rf.Scene(domain, material, order=order, mass="consistent")
    return scene.sum(scene.nodal_mass[: scene.owned_nodes].sum())


def counts(domain):
    """Number of entities of each name."""
    return {name: domain.count(entities) for (name, _), entities in domain.sets.items()}


# Mesh files -------------------------------------------------------------------------------------


def two_boxes(model):
    """Groups that overlap, in both dimensions."""
    one, two = model.occ.addBox(0, 0, 0, 1, 1, 1), model.occ.addBox(1, 0, 0, 1, 1, 1)
    model.occ.fragment([(3, one)], [(3, two)])
    model.occ.synchronize()
    bottom = [tag for _, tag in model.getEntitiesInBoundingBox(-1, -1, -1, 3, 3, 1e-3, dim=2)]
    model.addPhysicalGroup(3, [one, two], name="all")
    model.addPhysicalGroup(3, [two], name="right")
    model.addPhysicalGroup(2, bottom, name="bottom")
    model.addPhysicalGroup(2, bottom[:1], name="part of it")
    model.mesh.generate(3)


@alone
@pytest.mark.parametrize("order", [1, 2])
def test_both_versions_of_the_format(tmp_path, order):
    """Version 2.2 holds the cells of two groups twice; the domain does not."""
    found = {}
    for version in (2.2, 4.1):
        options = {"MshFileVersion": version, "MeshSizeMax": 0.5, "ElementOrder": order}
        domain = rf.read_msh(saved(tmp_path / f"{version}.msh", two_boxes, **options))
        found[version] = counts(domain)
        assert volume(domain) == pytest.approx(2.0, rel=1e-12)
    assert found[2.2] == found[4.1]
    assert found[4.1]["all"] > found[4.1]["right"] > 0
    assert found[4.1]["bottom"] > found[4.1]["part of it"] > 0


@alone
@pytest.mark.parametrize("version", [2.2, 4.1])
def test_names_of_the_header(tmp_path, version):
    """One without elements stands for nothing, whatever its kind; one twice is refused."""
    options = {"MshFileVersion": version, "MeshSizeMax": 1.0}
    path = saved(tmp_path / "two.msh", two_boxes, **options)
    text = path.read_text()
    more = '$PhysicalNames\n7\n0 70 "tip"\n2 4000 "ghost"\n3 71 "core"\n'
    domain = rf.read_msh(write(tmp_path / "more.msh", text.replace("$PhysicalNames\n4\n", more)))
    assert {name: n for name, n in counts(domain).items() if not n} == {
        "tip": 0,
        "ghost": 0,
        "core": 0,
    }
    steel = rf.StVenantKirchhoff(E=1.0, nu=0.3, rho=1.0)
    with pytest.raises(SceneError, match=r"the name 'ghost' stands for no facets at all"):
        rf.Scene(domain, steel, [rf.Fixed("ghost")])
    with pytest.raises(SceneError, match=r"the name 'tip' stands for no vertices at all"):
        rf.Scene(domain, steel, [rf.Fixed("tip")])
    again = write(tmp_path / "again.msh", text.replace('"part of it"', '"bottom"'))
    with pytest.raises(SceneError, match=r"'bottom' to several groups of facets, numbers \d, \d"):
        rf.read_msh(again)


def test_facets_that_bound_no_cell_of_a_function():
    """Half of a group is enough; of hexahedra, too; the face between is one of the mesh."""

    def model(gmsh, apart):
        geometry, model = gmsh.model.occ, gmsh.model
        geometry.addBox(0, 0, 0, 1, 1, 1)
        geometry.addRectangle(0, 3, 0, 1, 1, tag=50)
        geometry.synchronize()
        for _, tag in model.getEntities(1):
            model.mesh.setTransfiniteCurve(tag, 3)
        for _, tag in model.getEntities(2):
            model.mesh.setTransfiniteSurface(tag)
            model.mesh.setRecombine(2, tag)
        model.mesh.setTransfiniteVolume(1)
        model.addPhysicalGroup(3, [1], name="v")
        model.addPhysicalGroup(2, [1], name="good")
        model.addPhysicalGroup(2, [2, 50] if apart else [2], name="helper")
        model.mesh.generate(3)

    assert counts(rf.from_gmsh(lambda gmsh: model(gmsh, False))) == {"v": 8, "good": 4, "helper": 4}
    with pytest.raises(SceneError, match=r"of the facets 'helper' \(4 of 8\) bound no"):
        rf.from_gmsh(lambda gmsh: model(gmsh, True))


@alone
def test_numbers_of_nodes_with_gaps(tmp_path):
    """Other programs number nodes as they like."""
    path = saved(tmp_path / "two.msh", two_boxes, MshFileVersion=2.2)
    text = path.read_text()
    head, nodes, tail = re.split(r"\$Nodes\n|\$EndNodes\n", text)
    rows = [row.split() for row in nodes.splitlines()[1:]]
    shifted = "\n".join(" ".join([str(7 * int(n) + 3), *x]) for n, *x in rows)
    before, elements, after = re.split(r"\$Elements\n|\$EndElements\n", tail)
    cells = []
    for row in elements.splitlines()[1:]:
        n = [int(k) for k in row.split()]
        cells.append(" ".join(map(str, [*n[: 3 + n[2]], *(7 * k + 3 for k in n[3 + n[2] :])])))
    path.write_text(
        f"{head}$Nodes\n{len(rows)}\n{shifted}\n$EndNodes\n{before}"
        f"$Elements\n{len(cells)}\n" + "\n".join(cells) + f"\n$EndElements\n{after}"
    )
    domain = rf.read_msh(path)
    assert volume(domain) == pytest.approx(2.0, rel=1e-12)


@alone
def test_second_order_hexahedra(tmp_path):
    """27 nodes, curved: a quarter of a pipe has its volume; first-order displacement is refused."""

    def pipe(model):
        inner, outer = 1.0, 1.4
        x = [(inner, 0), (outer, 0)]
        p, q = (model.occ.addPoint(*at, 0) for at in x)
        line = model.occ.addLine(p, q)
        model.occ.revolve([(1, line)], 0, 0, 0, 0, 0, 1, np.pi / 2, [6], recombine=True)
        face = model.occ.getEntities(2)
        model.occ.extrude(face, 0, 0, 0.5, [2], recombine=True)
        model.occ.synchronize()
        for _, curve in model.getEntities(1):
            model.mesh.setTransfiniteCurve(curve, 7 if model.getType(1, curve) == "Circle" else 3)
        model.addPhysicalGroup(3, [tag for _, tag in model.getEntities(3)], name="pipe")
        model.mesh.generate(3)
        model.mesh.setOrder(2)

    domain = rf.read_msh(saved(tmp_path / "pipe.msh", pipe))
    assert len(cell_geometry_dofs(domain.mesh)[0]) == 27
    assert volume(domain) == pytest.approx(np.pi / 4 * (1.4**2 - 1) * 0.5, rel=1e-4)
    with pytest.raises(SceneError, match="geometry order 2"):
        rf.Scene(domain, rf.StVenantKirchhoff(E=1.0, nu=0.3, rho=1.0))


@alone
def test_cells_that_are_not_known(tmp_path):
    """20-node hexahedra, and facets that are none of the cells'."""
    script = """SetFactory("OpenCASCADE");
        Mesh.SecondOrderIncomplete = 1; Mesh.ElementOrder = 2;
        Box(1) = {0, 0, 0, 1, 1, 1};
        Transfinite Curve "*" = 3; Transfinite Surface "*"; Recombine Surface "*";
        Transfinite Volume "*";
        Physical Volume("v") = {1};\n"""
    with pytest.raises(SceneError, match=r"Hexahedron 20\. .*SecondOrderIncomplete = 0"):
        rf.read_geo(write(tmp_path / "serendipity.geo", script))
    script = """SetFactory("OpenCASCADE");
        Box(1) = {0, 0, 0, 1, 1, 1};
        Rectangle(20) = {2, 0, 0, 1, 1};
        Transfinite Surface {20}; Recombine Surface {20};
        Physical Volume("v") = {1};
        Physical Surface("elsewhere") = {20};\n"""
    with pytest.raises(SceneError, match=r"'elsewhere' are of these kinds: Quadrilateral 4"):
        rf.read_geo(write(tmp_path / "quads.geo", script))


# Scripts ----------------------------------------------------------------------------------------


def write(path, text):
    """A file with a text."""
    path.write_text(text)
    return path


def bracket_volume(length):
    """Of meshes/bracket.geo with its other parameters as they are [m³]."""
    back, arm, width, height, fillet, hole, block = 0.02, 0.006, 0.06, 0.1, 0.012, 0.012, 0.04
    section = back * height + length * arm + (1 - np.pi / 4) * fillet**2 + block**2
    return section * width - np.pi * hole**2 * arm


def test_script_and_its_parameters():
    """The bracket, shorter and longer; its names; a size; curved cells."""
    for length in (0.2, 0.3):
        domain = rf.read_geo(BRACKET, {"length": length})
        x = domain.mesh.geometry.x[:, 0].max(initial=-np.inf)
        assert domain.comm.allreduce(x, op=MPI.MAX) == pytest.approx(length)
        assert volume(domain) == pytest.approx(bracket_volume(length), rel=0.01)
    assert set(counts(domain)) == {"bracket", "wall", "end", "hole"}
    assert all(counts(domain).values())
    coarse = rf.read_geo(BRACKET, size=0.02, scale=2.0)  # [m], of a body that is twice as large
    fine = rf.read_geo(BRACKET, size=0.01)
    assert counts(coarse) == counts(fine)
    assert counts(fine)["bracket"] > counts(rf.read_geo(BRACKET, size=0.02))["bracket"]
    assert volume(coarse) == pytest.approx(8 * bracket_volume(0.2), rel=0.02)
    curved = rf.read_geo(BRACKET, order=2)
    assert volume(curved) == pytest.approx(bracket_volume(0.2), rel=1e-4)


def test_curved_cells_become_rigid_and_flexible_again():
    """A turning bracket of curved cells keeps energy and momentum at a freeze and a release."""
    with pytest.warns(rf.RigidfxWarning, match="1 of 523 cells would be inside out"):
        domain = rf.read_geo(BRACKET, size=0.03, order=2)
    spin = rf.InitialVelocity(angular=(1.0, 30.0, 5.0))
    scene = rf.Scene(
        domain,
        rf.StVenantKirchhoff(E=2e9, nu=0.3, rho=7850.0),
        [spin],
        order=2,
        mass="consistent",
    )
    criterion = rf.StrainRate(6.0, 6e-4, patience=1, release=rf.Release(at=1e-3), until=1e-3)
    reports = list(rf.simulate(scene, 2e-4, 1.2e-3, rigidify=criterion))
    freeze, release = (event for report in reports for event in report.events)
    assert (freeze.kind, release.kind) == ("freeze", "release")
    assert freeze.unknowns_after < freeze.unknowns_before
    energies = [report.energy for report in reports]
    assert energies == pytest.approx([energies[0]] * len(energies), rel=1e-10)
    momenta = np.array([report.angular_momentum for report in reports])
    assert np.abs(momenta - momenta[0]).max() <= 1e-11 * np.linalg.norm(momenta[0])


@alone
def test_parameters_that_are_texts_and_those_of_included_scripts(tmp_path):
    """A script's constants are those of all its files; comments define none."""
    write(
        tmp_path / "inner.geo",
        """SetFactory("OpenCASCADE");
        DefineConstant[ L = {1, Choices {1, 2}, Name "P/L"}, who = "box" /* x = 1 */ ];
        Box(1) = {0, 0, 0, L, 1, 1};
        Physical Volume(Str(who)) = {1};\n""",
    )
    outer = write(tmp_path / "outer.geo", '// DefineConstant[ no = 1 ];\nInclude "inner.geo";\n')
    domain = rf.read_geo(outer, {"L": 2.0, "who": "beam"}, size=1.0)
    assert list(counts(domain)) == ["beam"]
    assert volume(domain) == pytest.approx(2.0)
    assert volume(rf.read_geo(outer, size=1.0)) == pytest.approx(1.0)  # nothing is left behind
    with pytest.raises(SceneError, match=r"no parameter 'no'.*DefineConstant: L, who\."):
        rf.read_geo(outer, {"no": 1})
    with pytest.raises(SceneError, match=r"'who' .* must be a text, got 1"):
        rf.read_geo(outer, {"who": 1})
    with pytest.raises(SceneError, match=r"'L' .* must be a number, got 'a'"):
        rf.read_geo(outer, {"L": "a"})


def test_a_session_of_the_users_is_kept():
    """Whoever uses gmsh himself finds his model and his options as he left them."""
    first = MPI.COMM_WORLD.rank == 0
    if first:
        gmsh.initialize(interruptible=False)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 7.0)
        gmsh.model.add("mine")
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
    try:
        rf.read_geo(BRACKET, size=0.05)
        if first:
            assert gmsh.model.getCurrent() == "mine"
            assert gmsh.model.getEntities(3) == [(3, 1)]
            assert gmsh.option.getNumber("Mesh.MeshSizeMax") == 7.0
            assert "rigidfx" not in gmsh.model.list()
    finally:
        if first:
            gmsh.finalize()


# CAD --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cad(tmp_path_factory):
    """A drilled plate of 100 × 50 × 20 and a smaller block that touches it, as STEP and BREP."""
    folder = tmp_path_factory.mktemp("cad")

    def model(model):
        plate = model.occ.addBox(0, 0, 0, 100, 50, 20)
        drill = model.occ.addCylinder(50, 25, -1, 0, 0, 22, 8)
        model.occ.cut([(3, plate)], [(3, drill)])
        model.occ.addBox(100, 10, 0, 30, 20, 20)
        model.occ.synchronize()
        gmsh.write(str(folder / "two.brep"))

    saved(folder / "two.step", model)
    text = (folder / "two.step").read_text()
    labelled = re.sub(r"Open CASCADE STEP translator \S+ \d+", "part", text)  # it counts files
    (folder / "labelled.step").write_text(labelled)
    inches = text.replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT(.CENTI.,.METRE.)")
    (folder / "cm.step").write_text(inches)
    return folder


PLATE = (100 * 50 - np.pi * 8**2) * 20e-9  # m³
BLOCK = 30 * 20 * 20e-9  # m³


@alone
def test_cad_is_listed(cad):
    """Numbers, kinds, places, areas, outward normals; as a table, too."""
    found = rf.list_cad(cad / "two.step")
    assert [v.measure for v in found.volumes] == pytest.approx([PLATE, BLOCK], rel=1e-9)
    (hole,) = [s for s in found.surfaces if s.kind == "Cylinder"]
    assert hole.radius == pytest.approx(0.008)
    assert hole.centre == pytest.approx([0.05, 0.025, 0.01])
    assert np.isnan(hole.normal).all()
    for s in found.surfaces:
        if s.kind == "Plane" and s.centre[0] < 0.09:
            outward = s.centre - [0.05, 0.025, 0.01]
            assert s.normal @ outward > 0.9 * np.linalg.norm(outward)
    text = str(found)
    assert "Volumes:" in text
    assert "Cylinder at (0.05, 0.025, 0.01) m" in text
    assert "radius 0.008 m" in text
    assert len(text.splitlines()) == 2 + len(found.volumes) + len(found.surfaces)
    separate = rf.list_cad(cad / "two.step", glue=False)
    assert len(separate.surfaces) == 6 + 7  # glued, the block's face divides the plate's in three
    assert len(found.surfaces) == len(separate.surfaces) + 1


@alone
def test_splines_are_listed_as_what_they_are(tmp_path):
    """Boxes were those of poles, and radii unknown: programs write splines for planes and holes."""

    def model(model):
        bracket = model.occ.addBox(0, 0, 0, 200, 50, 10)
        wall = model.occ.addBox(0, 0, 0, 10, 50, 100)
        hole = model.occ.addCylinder(100, 25, -1, 0, 0, 12, 8)
        whole, _ = model.occ.fuse([(3, bracket)], [(3, wall)])
        drilled, _ = model.occ.cut(whole, [(3, hole)])
        ball = model.occ.addSphere(100, 25, 200, 15)
        model.occ.synchronize()
        model.occ.convertToNURBS([*drilled, (3, ball)])
        model.occ.synchronize()

    found = rf.list_cad(saved(tmp_path / "splines.step", model))
    assert all("pline" in s.kind for s in found.surfaces)
    hole, ball = (s for s in found.surfaces if np.isfinite(s.radius))
    assert (hole.radius, ball.radius) == pytest.approx((0.008, 0.015), rel=1e-6)
    assert hole.upper - hole.lower == pytest.approx([0.016, 0.016, 0.01], rel=1e-3)
    assert hole.within((0.09, 0.015, -1), (0.11, 0.035, 1))
    flat = [s for s in found.surfaces if np.isfinite(s.normal).all()]
    assert len(flat) == len(found.surfaces) - 2
    for s in flat:
        axis = np.abs(s.normal).argmax()
        assert s.normal[axis] ** 2 == pytest.approx(1.0)
        assert s.upper[axis] - s.lower[axis] < 1e-9
    assert sum(s.normal * s.measure for s in flat) == pytest.approx(np.zeros(3), abs=1e-5)


@alone
def test_volume_that_cells_lose_is_told(tmp_path):
    """A shaft that has become a prism."""

    def model(model):
        model.occ.addCylinder(0, 0, 0, 0, 0, 60, 10)
        model.occ.synchronize()

    shaft = saved(tmp_path / "shaft.step", model)
    lost = r"m³: (\S+)% less mass.*per_circle=16"
    with pytest.warns(rf.RigidfxWarning, match=lost) as told:
        coarse = rf.read_cad(shaft, size=0.05)
    share = float(re.search(lost, str(told[0].message))[1]) / 100
    assert share == pytest.approx(1 - volume(coarse) / (np.pi * 6e-6), rel=0.1)
    assert share > 0.03
    assert "curved ones (order=2)" in str(told[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rf.read_cad(shaft, size=0.01, order=2)


@alone
def test_names_of_cad(cad):
    """By number, by a condition, by a box, several at once; volumes that touch are one body."""
    domain = rf.read_cad(
        cad / "two.step",
        volumes={"plate": 1, "block": lambda v: v.measure < 2e-5, "both": [1, 2]},
        surfaces={
            "hole": lambda s: s.radius > 0,
            "ends": [
                lambda s: s.normal[0] > 0.99 and s.centre[0] > 0.12,
                lambda s: s.upper[0] < 1e-6,
            ],
            "block's": lambda s: s.volumes == (2,),
            "seat": lambda s: s.volumes == (1, 2),
            "upper": lambda s: s.within((0, 0, 0.019), (1, 1, 1)),
        },
        size=0.012,
    )
    assert volume(domain) == pytest.approx(PLATE + BLOCK, rel=5e-3)
    n = counts(domain)
    assert n["plate"] + n["block"] == n["both"] == domain.mesh.topology.index_map(3).size_global
    for name, area in (
        ("ends", 0.0014),
        ("hole", 2 * np.pi * 0.008 * 0.02),
        ("block's", 0.0028),
        ("upper", 0.0056 - np.pi * 0.008**2),
    ):
        push = rf.Traction(name, (1e6, 0, 0))
        scene = rf.Scene(domain, rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7850.0), [push])
        *_, last = rf.simulate(scene, 1e-6, 1e-6)
        # facets between the parts are none of the surface
        assert last.linear_momentum[0] == pytest.approx(area, rel=0.05)
    assert n["seat"] > 0
    separate = rf.read_cad(cad / "two.step", size=0.012, glue=False)
    joined = domain.mesh.topology.index_map(0).size_global
    assert separate.mesh.topology.index_map(0).size_global > joined


@alone
def test_units_of_cad(cad):
    """STEP says its unit; BREP does not, and a file may be wrong."""
    both = PLATE + BLOCK
    assert volume(rf.read_cad(cad / "cm.step", size=0.2)) == pytest.approx(1e3 * both, rel=0.03)
    brep = rf.read_cad(cad / "two.brep", scale=1e-3, size=0.02)
    assert volume(brep) == pytest.approx(both, rel=0.03)
    with pytest.raises(SceneError, match=r"larger than all of .*Is the unit right"):
        rf.read_cad(cad / "two.step", size=20.0)
    curved = rf.read_cad(cad / "two.step", order=2, per_circle=16)
    assert volume(curved) == pytest.approx(both, rel=1e-5)


@alone
@pytest.mark.parametrize("splines", [False, True])
def test_a_bolt_hole_has_twelve_sides_by_default(tmp_path, splines):
    """Also where it is a spline, whose circles gmsh does not know: it had four sides."""

    def model(model):
        plate, drill = (
            model.occ.addBox(0, 0, 0, 100, 60, 10),
            model.occ.addCylinder(50, 30, -5, 0, 0, 20, 4),
        )
        model.occ.cut([(3, plate)], [(3, drill)])
        model.occ.synchronize()
        if splines:
            model.occ.convertToNURBS(model.getEntities(3))
            model.occ.synchronize()

    path = saved(tmp_path / "plate.step", model)
    for more, sides in (({}, 12), ({"per_circle": 20}, 20)):
        x = rf.read_cad(path, size=0.02, **more).mesh.geometry.x
        round_ = np.abs(np.hypot(x[:, 0] - 0.05, x[:, 1] - 0.03) - 0.004) < 1e-7
        assert np.count_nonzero(round_ & (np.abs(x[:, 2]) < 1e-9)) == pytest.approx(sides, abs=1)


INCHES = """( CONVERSION_BASED_UNIT('INCH',#900001) LENGTH_UNIT() NAMED_UNIT(#900002) );
#900001 = LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#900003);
#900002 = DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);
#900003 = ( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) );"""


@alone
def test_a_part_in_inches_with_a_label_of_several_pieces(cad, tmp_path):
    """Sizes are metres; a label stands for all of its pieces, whichever of them has a name, too."""
    text = (cad / "labelled.step").read_text()
    text = re.sub(
        r"\(\s*LENGTH_UNIT\(\)\s*NAMED_UNIT\(\*\)\s*SI_UNIT\(.MILLI.,.METRE.\)\s*\);", INCHES, text
    )
    assert "INCH" in text
    (tmp_path / "bolts.step").write_text(re.sub(r"'part.\d'", "'bolt'", text))
    found = rf.list_cad(tmp_path / "bolts.step")
    assert [v.label for v in found.volumes] == ["bolt", "bolt"]
    upper = np.max([v.upper for v in found.volumes], axis=0)
    assert upper == pytest.approx(0.0254 * np.array([130, 50, 20]), rel=1e-6)
    assert found.volumes[0].measure == pytest.approx(25.4**3 * PLATE, rel=1e-6)
    hole = next(s for s in found.surfaces if np.isfinite(s.radius))
    assert hole.radius == pytest.approx(8 * 0.0254)
    part = rf.read_cad(tmp_path / "bolts.step", volumes={"small": 2}, size=0.6)
    cells = counts(part)
    assert cells["bolt"] == part.mesh.topology.index_map(3).size_global > cells["small"] > 0


@alone
def test_names_of_cad_that_are_refused(cad):
    """What picks nothing is answered with what there is; so is a volume without a name."""
    step = cad / "two.step"
    for options, match in (
        ({"surfaces": {"a": 77}}, r"'a': there are no surfaces 77(.|\n)*Surfaces:\n(.|\n)*Plane"),
        ({"surfaces": {"a": lambda s: s.radius > 1}}, "'a': there are no surfaces with its cond"),
        ({"surfaces": {"a": "seat"}}, "there are no surfaces 'seat'"),
        ({"surfaces": {"a": []}}, "'a' picks nothing"),
        ({"surfaces": {"a": 1.5}}, "must be a number, a label, a function"),
        (
            {"surfaces": {"a": lambda s: s.colour}},
            "^read_cad: the condition of 'a' failed with Attr",
        ),
        ({"volumes": {"b": lambda v: 1 / 0}}, "of 'b' failed with Zero.*at volume 1 of kind"),
        (
            {"leave_out": lambda v: v.normal > 1},
            "the condition of leave_out failed with ValueError",
        ),
        ({"per_circle": -1}, "per_circle must be"),
    ):
        with pytest.raises(SceneError, match=match):
            rf.read_cad(step, **options)
        assert not gmsh.isInitialized()
    with pytest.raises(SceneError, match=r"no label stands for volume 2(.|\n)*\n +1  Volume"):
        rf.read_cad(cad / "two.brep", volumes={"plate": 1}, scale=1e-3)
    ends = {"ends": lambda s: abs(s.normal[0]) > 0.99}  # of both
    part = rf.read_cad(step, volumes={"plate": 1}, surfaces=ends, leave_out=2, size=0.02)
    assert volume(part) == pytest.approx(PLATE, rel=0.03)
    assert counts(part)["ends"] > 0
    far = {"far": lambda s: s.volumes == (2,)}
    with pytest.raises(SceneError, match=r"'far' picks only surfaces that bound no volume which"):
        rf.read_cad(step, surfaces=far, leave_out=2)


# On several ranks -------------------------------------------------------------------------------


def adaptive():
    """A bracket that is hit and swings: unknowns, bodies and energies, step by step."""
    domain = rf.read_geo(BRACKET, size=0.02)
    scene = rf.Scene(
        domain,
        rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7850.0),
        [
            rf.Fixed("wall"),
            rf.Traction("end", (0, 0, -3e5), until=1e-3),
            rf.NumericalDamping(0.05),
        ],
        probes={"end": (0.2, 0.03, -0.003)},
    )
    criterion = rf.StrainRate(0.1, 4e-3, min_cells=5, patience=1, since=1e-3)
    rows = []
    for r in rf.simulate(scene, 5e-4, 1.4e-2, rigidify=criterion):
        rows.append(
            {
                "unknowns": r.unknowns,
                "bodies": [[b.number, b.cells] for b in r.bodies],
                "energy": [r.kinetic, r.strain, r.stored],
                "end": r.probes["end"].tolist(),
            }
        )
    sizes = {name: domain.count(entities) for (name, _), entities in domain.sets.items()}
    return {"rows": rows, "sizes": sizes}


@pytest.fixture(scope="module")
def runs():
    """What this file as a script found, by the number of ranks."""
    return {n: parallel.run(__file__, n, 240) for n in (1, 2)}


@pytest.mark.parallel
def test_regions_on_several_ranks(runs):
    """The same bodies at the same times, tags and histories."""
    one, several = runs[1]["adaptive"], runs[2]["adaptive"]
    assert one["sizes"] == several["sizes"]
    for key in ("unknowns", "bodies"):
        assert [row[key] for row in one["rows"]] == [row[key] for row in several["rows"]]
    for key in ("energy", "end"):
        a, b = (np.array([row[key] for row in run["rows"]]) for run in (one, several))
        assert np.abs(a - b).max() <= 1e-9 * np.abs(a).max()
    assert one["rows"][-1]["unknowns"] < one["rows"][0]["unknowns"]


if __name__ == "__main__":
    parallel.report({"adaptive": adaptive()})
