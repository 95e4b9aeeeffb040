"""Own parts: faces of one of two that touch, balls, places of faults, sizes, damaged files."""

import re

import numpy as np
import pytest
from cad import saved
from hardcases.cad_parts import lug_scene
from mpi4py import MPI

import rigidfx as rf

alone = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="writes files")

SOFT = rf.StVenantKirchhoff(E=1e7, nu=0.3, rho=1000.0)


def stacked():
    """Two bars, one on the other, that touch and share no nodes."""
    points, cells = [], []
    for k in (0, 1):
        points += [(x, y, z) for z in (k, k + 1) for y in (0, 1) for x in (0, 1, 2)]
        cells += [[12 * k + n + i for n in (0, 1, 3, 4, 6, 7, 9, 10)] for i in (0, 1)]
    domain = rf.from_arrays(np.array(points, dtype=float), np.array(cells), comm=MPI.COMM_SELF)
    domain = domain.with_cells("low", lambda x: x[2] < 1 + 1e-9)
    return domain.with_cells("high", lambda x: x[2] > 1 - 1e-9)


def test_faces_of_one_of_two_parts_that_touch():
    """Both have facets where they touch; `of` names the part that they bound."""

    def touching(x):
        return np.abs(x[2] - 1) < 1e-9

    part = stacked().with_facets("both", touching)
    part = part.with_facets("lid", touching, of="low").with_facets("seat", touching, of="high")
    sets = {name: set(part.sets[name, 2].entities.tolist()) for name in ("both", "lid", "seat")}
    assert [len(found) for found in sets.values()] == [4, 2, 2]
    assert sets["lid"] | sets["seat"] == sets["both"]
    part.mesh.topology.create_connectivity(2, 3)
    cells = {part.mesh.topology.connectivity(2, 3).links(facet)[0] for facet in sets["lid"]}
    assert cells == set(part.sets["low", 3].entities)
    for of, match in (
        ("high", "no facet at the boundary of the cells 'high'"),
        ("middle", "there are no cells named 'middle'"),
        (3, "of must be the name of cells"),
    ):
        with pytest.raises(rf.SceneError, match=match):
            part.with_facets("foot", lambda x: x[2] < 1e-9, of=of)


def test_materials_that_overlap_are_named():
    """With a place; cells without a material have one, too."""
    part = rf.box((0, 0, 0), (4, 1, 1), (8, 1, 1))
    part = part.with_cells("a", lambda x: x[0] < 2.6).with_cells("b", lambda x: x[0] > 1.9)
    with pytest.raises(rf.SceneError, match=r"1 have several: one in 'a' and 'b', around \(2.25, "):
        rf.Scene(part, {"a": SOFT, "b": SOFT})
    with pytest.raises(
        rf.SceneError, match=r"0 have several: one without one, around \(\S+, 0.5, "
    ):
        rf.Scene(part, {"a": SOFT})


def cap(ball):
    """A quarter of a shell of radius 0.3 m about a place far off, its side of 0.3 m named."""
    centre = np.array([100.5, 0.5, -7.0])
    a, b = (grid.ravel() for grid in np.meshgrid(*[np.linspace(0.3, 1.2, 4)] * 2, indexing="ij"))
    height = np.sin(b) if ball else b - 0.75
    across = np.cos(b) if ball else np.ones(len(b))
    ray = np.stack([across * np.cos(a), across * np.sin(a), height], axis=1)
    outer = ray if ball else ray * (1, 1, 0)
    points = np.vstack([centre + 0.3 * ray, centre + 0.3 * ray + 0.1 * outer])
    first = np.array([4 * i + j for i in range(3) for j in range(3)])
    cells = np.stack([first + k for k in (0, 1, 4, 5, 16, 17, 20, 21)], axis=1)
    part = rf.from_arrays(points, cells, comm=MPI.COMM_SELF)

    def inside(x):
        r = x - centre[:, None]
        return np.linalg.norm(r if ball else r[:2], axis=0) < 0.3 + 1e-6

    return part.with_facets("round", inside), centre


@pytest.mark.parametrize("ball", [True, False])
def test_a_ball_or_a_hole_tells_the_place_of_a_spherical_joint(ball):
    """To rounding."""
    part, centre = cap(ball)
    scene = rf.Scene(part, SOFT, [rf.Spherical("ground", rf.MeanFace("round"))])
    assert scene.named(rf.Spherical)[0].at == pytest.approx(centre, abs=1e-12)
    if not ball:
        part = part.with_facets("flat", lambda x: x[2] < x[2].min() + 1e-6)
        with pytest.raises(rf.SceneError, match="'flat' is neither a ball nor a socket"):
            rf.Scene(part, SOFT, [rf.Spherical("ground", rf.MeanFace("flat"))])


# Files ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def step(tmp_path_factory):
    """A block of 40 × 20 × 10 mm whose upper edge is an arch of a spline, as STEP."""

    def build(model):
        occ = model.occ
        p = [occ.addPoint(x, 0, z) for x, z in ((0, 0), (40, 0), (40, 10), (20, 16), (0, 10))]
        edges = [occ.addLine(p[0], p[1]), occ.addLine(p[1], p[2])]
        edges += [occ.addSpline([p[2], p[3], p[4]]), occ.addLine(p[4], p[0])]
        occ.extrude([(2, occ.addPlaneSurface([occ.addCurveLoop(edges)]))], 0, 20, 0)
        occ.synchronize()

    return saved(tmp_path_factory.mktemp("cad") / "arch.step", build)


@alone
def test_an_extruded_spline_is_no_plane(step):
    """Curvatures were taken outside of the surface. A condition that finds nothing shows kinds."""
    flat = [s for s in rf.list_cad(step).surfaces if np.isfinite(s.normal).all()]
    assert len(flat) == 5
    assert sum(s.normal[2] for s in flat) == pytest.approx(-1.0)
    kinds = sorted(s.kind for s in rf.list_cad(step).surfaces)
    assert kinds == ["Other surface", *["Plane"] * 5]  # gmsh has no name for it
    with pytest.raises(rf.SceneError, match=r"kinds there: '[\w ]+', 'Plane'\)"):
        rf.read_cad(step, surfaces={"hole": lambda s: s.kind == "cylinder"})


@alone
def test_sizes_that_give_the_same_mesh(step):
    """A size above a tenth of the diagonal is none; it looked like a mesh that has converged."""
    rf.read_cad(step, size=0.02)
    with pytest.warns(rf.RigidfxWarning, match=r"sizes 0.02 m and 0.01 m give the same mesh"):
        rf.read_cad(step, size=0.01)
    rf.read_cad(step, size=0.01)
    rf.read_cad(step, size=0.003)


@alone
def test_a_damaged_file_does_not_end_python(step, tmp_path, capfd):
    """OpenCASCADE ended it over an entity that is not there; and it wrote in green."""
    text = step.read_text()
    hole = re.sub(r"#\d+ = CARTESIAN_POINT[^;]*;", "", text, count=1)
    for name, other in (("cut", text[: len(text) // 3]), ("hole", hole)):
        path = tmp_path / f"{name}.step"
        path.write_text(other)
        with pytest.raises(rf.SceneError, match=r"damaged: it names entities .* such as #\d+"):
            rf.list_cad(path)
    (tmp_path / "named.step").write_text(text.replace("PRODUCT('", "PRODUCT('#99999 of ''", 1))
    (tmp_path / "named.stp").write_text(text.replace("DATA;", "DATA; /* #99999 */", 1))
    assert len(rf.list_cad(tmp_path / "named.step").volumes) == 1
    assert len(rf.list_cad(tmp_path / "named.stp").volumes) == 1
    assert capfd.readouterr().out == ""


@alone
def test_opencascade_writes_nothing_to_the_terminal(tmp_path, capfd):
    """Where functions and scripts of a user read and write CAD; what these print stays."""
    pytest.importorskip("gmsh")
    path = str(tmp_path / "cube.step")

    def cube(gmsh):
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.write(path)
        gmsh.merge(path)
        print("written")
        gmsh.model.addPhysicalGroup(3, [1, 2], name="cubes")
        gmsh.option.setNumber("Mesh.MeshSizeMin", 1.0)
        gmsh.model.mesh.generate(3)

    rf.from_gmsh(cube, MPI.COMM_SELF)
    rf.read_cad(path, size=5e-4, comm=MPI.COMM_SELF)
    script = f'SetFactory("OpenCASCADE");\nMerge "{path}";\nSave "{path}";\n'
    (tmp_path / "cube.geo").write_text(f'{script}Physical Volume("cube") = {{1}};\n')
    rf.read_geo(tmp_path / "cube.geo", size=0.5, comm=MPI.COMM_SELF)
    assert capfd.readouterr().out == "written\n"


@pytest.fixture(scope="module")
def scene():
    return lug_scene(1.0, 2, "consistent")


def test_averaging_mass_is_positive(scene):
    """Nodal masses are not, though they add up to the mass; point masses count in both."""
    assert scene.nodal_mass.min() < 0 < scene.averaging_mass.min()
    n = scene.owned_nodes
    assert scene.sum(scene.nodal_mass[:n].sum()) == pytest.approx(1000.0 * (8 + 18), rel=1e-12)
