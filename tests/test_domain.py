"""Meshes with names: boxes, gmsh files, and cells that are not whole."""

import dolfinx.mesh as dmesh
import numpy as np
import pytest
from block_with_cantilever import block_with_cantilever
from cad import saved
from histories import EPS
from mpi4py import MPI
from spatial_frame import spatial_frame
from tumbling_l import tumbling_l

import rigidfx as rf
from rigidfx.base.errors import SceneError
from rigidfx.domain.domain import Domain

CELLS = pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
MATERIAL = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)


def _mass(domain, **options):
    scene = rf.Scene(domain, MATERIAL, **options)
    return scene.sum(scene.nodal_mass[: scene.owned_nodes].sum())


@CELLS
def test_box(cell):
    """Its volume, its number of cells and its six named faces."""
    domain = rf.box((1, 2, 3), (3, 5, 4), (2, 3, 4), cell)
    assert _mass(domain) == pytest.approx(2.0 * 6.0, rel=100 * EPS)
    cubes = 24 if cell == "hexahedron" else 24 * 6
    assert domain.mesh.topology.index_map(3).size_global == cubes
    per_square = 1 if cell == "hexahedron" else 2
    for name, squares in {"x0": 12, "x1": 12, "y0": 8, "y1": 8, "z0": 6, "z1": 6}.items():
        faces = domain.find(name, (2,), "test")
        assert domain.count(faces) == squares * per_square
        x = domain.mesh.geometry.x[dmesh.entities_to_geometry(domain.mesh, 2, faces.entities)]
        axis, side = "xyz".index(name[0]), int(name[1])
        assert np.all(x[:, :, axis] == [(1, 2, 3), (3, 5, 4)][side][axis])


@CELLS
def test_tumbling_l(cell):
    """Mass, centre and inertia of the reference problem, for ρ = 1."""
    scene = rf.Scene(
        tumbling_l(cell=cell), rf.StVenantKirchhoff(rho=1.0, E=1.0, nu=0.3), mass="consistent"
    )
    n = scene.owned_nodes
    assert scene.sum(scene.nodal_mass[:n].sum()) == pytest.approx(117.0, rel=100 * EPS)
    expected = [2.1923077, 4.1923077, 1.5]
    assert scene.centre_of_mass == pytest.approx(expected, abs=1e-7)  # digits printed
    if cell == "hexahedron":
        assert n == 224


@pytest.mark.parametrize("refine", [1, 2])
def test_block_with_cantilever(refine):
    """574 nodes at first; a finer mesh is the same body with the same named parts."""
    domain = block_with_cantilever(refine)
    scene = rf.Scene(domain, MATERIAL)
    cells = domain.mesh.topology.index_map(3).size_global
    assert cells == 366 * refine**3
    if refine == 1:
        assert scene.space.dofmap.index_map.size_global == 574
    assert _mass(domain) == pytest.approx(2.0 * (9 * 5.4 * 6 + 14 * 1.8 * 2), rel=1e3 * EPS)
    probes = {"tip": (23.0, 2.7, 3.0), "corner": (0.0, 5.4, 6.0)}
    assert set(rf.Scene(domain, MATERIAL, probes=probes).probes) == set(probes)
    for name in ("block", "cantilever"):
        domain.find(name, (3,), "test")
    for name in ("block top and bottom", "tip"):
        domain.find(name, (0,), "test")


@pytest.mark.parametrize(("refine", "coarse", "thickness"), [(1, 1, 1.5), (1, 3, 1.0), (2, 3, 1.5)])
def test_spatial_frame(refine, coarse, thickness):
    """The columns keep their cells where the plate is coarse, and the frame its volume."""
    pytest.importorskip("gmsh")
    domain = spatial_frame(refine, coarse, thickness)
    columns = domain.find("columns", (3,), "test").entities
    owned = domain.mesh.topology.index_map(3).size_local
    count = domain.comm.allreduce(int((columns < owned).sum()))
    assert count == 2 * 2 * 2 * 10 * refine**3
    volume = 6 * 3 * thickness + 2 * 0.25 * 0.25 * 3
    assert _mass(domain) == pytest.approx(2.0 * volume, rel=1e3 * EPS)


def test_names_are_added_to_a_new_domain():
    """Cells, facets, vertices by marker; the old domain stays as it was."""
    old = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
    new = (
        old.with_cells("left", lambda x: x[0] < 2 + 1e-9)
        .with_facets("strip", lambda x: (x[2] > 1 - 1e-9) & (x[0] < 2 + 1e-9))
        .with_vertices("line", lambda x: np.isclose(x[0], 2.0))
        .with_cell_set("first", [0])
    )
    counts = {("left", 3): 2, ("strip", 2): 2, ("line", 0): 4, ("first", 3): 1}
    for (name, dim), count in counts.items():
        assert new.count(new.find(name, (dim,), "test")) == count
        with pytest.raises(SceneError, match=f"named '{name}'"):
            old.find(name, (dim,), "test")
    scene = rf.Scene(new, MATERIAL)
    assert scene.nodes("line", "test").size == 4
    assert scene.nodes("left", "test").size == 12
    assert scene.nodes("strip", "test").size == 6


# Cells that are not whole -----------------------------------------------------------------------


def _moved(cell, towards):
    """A box of 3×3×3 cubes whose vertex at (1, 1, 1) is moved elsewhere."""
    mesh = rf.box((0, 0, 0), (3, 3, 3), (3, 3, 3), cell).mesh
    x = mesh.geometry.x
    x[np.linalg.norm(x - 1.0, axis=1) < 1e-9] = towards
    return mesh


@CELLS
def test_moved_but_whole_cells(cell):
    """A distorted mesh is not an inverted one."""
    Domain(_moved(cell, (1.2, 0.9, 1.15)))


@pytest.mark.filterwarnings("ignore:Scene. its mass is")
def test_a_tiny_mesh_is_not_flat():
    """Volumes are judged relative to the cells' size: a box of a micrometre is fine."""
    for size in (1e-6, 1e6):
        assert _mass(rf.box((0, 0, 0), (size,) * 3, (2, 2, 2))) == pytest.approx(2 * size**3)


def test_meshes_of_other_kinds():
    """Surfaces, lines and prisms are refused."""
    comm = MPI.COMM_WORLD
    with pytest.raises(SceneError, match="three-dimensional"):
        Domain(dmesh.create_unit_square(comm, 2, 2))
    with pytest.raises(SceneError, match="three-dimensional"):
        Domain(dmesh.create_unit_interval(comm, 2))
    with pytest.raises(SceneError, match="hexahedra and tetrahedra"):
        Domain(dmesh.create_unit_cube(comm, 1, 1, 1, dmesh.CellType.prism))


# What a scene refuses ---------------------------------------------------------------------------


# Files of gmsh ----------------------------------------------------------------------------------

pytest.importorskip("gmsh")


def write_msh(path, *, volumes=True, order=1, sphere=False):
    """Two boxes in a row: cells "left", "right", facets "end" and a group without a name."""

    def build(model):
        if sphere:
            ball = model.occ.addSphere(0, 0, 0, 1.0)
            model.occ.synchronize()
            model.addPhysicalGroup(3, [ball], name="ball")
        else:
            a = model.occ.addBox(0, 0, 0, 1, 1, 1)
            b = model.occ.addBox(1, 0, 0, 2, 1, 1)
            model.occ.fragment([(3, a)], [(3, b)])
            model.occ.synchronize()
            if volumes:
                model.addPhysicalGroup(3, [a], 7, name="left")
                model.addPhysicalGroup(3, [b], 9, name="right")
            faces = model.getEntitiesInBoundingBox(2.99, -1, -1, 3.01, 2, 2, 2)
            model.addPhysicalGroup(2, [tag for _, tag in faces], 3, name="end")
            faces = model.getEntitiesInBoundingBox(-0.01, -1, -1, 0.01, 2, 2, 2)
            model.addPhysicalGroup(2, [tag for _, tag in faces], 4)
        model.mesh.generate(3 if volumes else 2)
        model.mesh.setOrder(order)

    return saved(path, build, MeshSizeMax=0.6 if sphere else 0.7)


def test_gmsh_file(tmp_path):
    """Physical groups become names, by which materials, loads and supports find their cells."""
    domain = rf.read_msh(write_msh(tmp_path / "bar.msh"))
    assert set(domain.sets) == {("left", 3), ("right", 3), ("end", 2), ("facets-4", 2)}
    heavy = rf.StVenantKirchhoff(rho=5.0, E=50.0, nu=0.3)
    scene = rf.Scene(
        domain,
        {"left": heavy, "right": MATERIAL},
        [rf.Fixed("facets-4"), rf.Traction("end", (0.0, 1.0, 0.0))],
        probes={"tip": (3.0, 0.5, 0.5)},
    )
    mass = scene.sum(scene.nodal_mass[: scene.owned_nodes].sum())
    assert mass == pytest.approx(5.0 * 1 + 2.0 * 2, rel=1e3 * EPS)
    *_, last = rf.simulate(scene, 0.1, 0.5)
    assert last.probes["tip"][1] > 0.0


def test_gmsh_file_of_curved_cells(tmp_path):
    """Second-order cells need second-order displacement; their curved volume is kept."""
    domain = rf.read_msh(write_msh(tmp_path / "ball.msh", order=2, sphere=True))
    with pytest.raises(SceneError, match="geometry order 2"):
        rf.Scene(domain, MATERIAL, mass="consistent")
    mass = _mass(domain, order=2, mass="consistent")
    straight = _mass(rf.read_msh(write_msh(tmp_path / "flat.msh", sphere=True)))
    exact = 2.0 * 4 / 3 * np.pi
    assert abs(mass - exact) < 0.1 * abs(straight - exact)


def test_gmsh_files_that_cannot_be_read(tmp_path):
    """A folder, no mesh at all, without volume cells."""
    with pytest.raises(SceneError, match="no mesh file"):
        rf.read_msh(tmp_path)
    (tmp_path / "text.msh").write_text("This is no mesh.\n")
    with pytest.raises(SceneError, match="Files of other kinds are known by their names"):
        rf.read_msh(tmp_path / "text.msh")
    (tmp_path / "cut.msh").write_text("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 8 1")
    with pytest.raises(SceneError):
        rf.read_msh(tmp_path / "cut.msh")
    with pytest.raises(SceneError, match=r"no physical group of volume cells.*'end' \(facets\)"):
        rf.read_msh(write_msh(tmp_path / "surface.msh", volumes=False))


@pytest.mark.parametrize(
    ("recombine", "found"),
    [(True, "Prism.*recombine them to quad"), (None, "generate the mesh in 3D before")],
)
def test_files_without_usable_cells(tmp_path, recombine, found):
    """Prisms are named, and a group that has no cells."""

    def build(model):
        base = model.occ.addRectangle(0, 0, 0, 1, 1)
        model.occ.extrude([(2, base)], 0, 0, 1, numElements=[2], recombine=True)
        model.occ.synchronize()
        model.addPhysicalGroup(3, [tag for _, tag in model.getEntities(3)], name="body")
        model.mesh.generate(3 if recombine else 2)

    with pytest.raises(SceneError, match=found):
        rf.read_msh(saved(tmp_path / "file.msh", build, MeshSizeMax=0.5))


def test_messages_show_plain_numbers():
    with pytest.raises(rf.SceneError, match=r"got \(0\.5, 1\.0\)\."):
        rf.Traction("x0", (np.float64(0.5), np.float32(1.0)))


def test_scale_of_a_model():
    pytest.importorskip("gmsh")

    def cube(gmsh):
        volume = gmsh.model.occ.addBox(0, 0, 0, 1000, 1000, 1000)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [volume], name="cube")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 1000)
        gmsh.model.mesh.generate(3)

    mesh = rf.from_gmsh(cube, scale=1e-3).mesh
    assert mesh.geometry.x.max(initial=0.0) <= 1.0
    with pytest.raises(rf.SceneError, match="from_gmsh: scale must be"):
        rf.from_gmsh(cube, scale=0)
