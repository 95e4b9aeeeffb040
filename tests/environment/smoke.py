"""What must work where rigidfx runs: ./fenicsx takes no new folder for whole before this does."""

from importlib.util import find_spec

if find_spec("dolfinx_solver"):
    import dolfinx_solver  # noqa: F401 - of the wheel, before DOLFINx

# isort: split
import dolfinx
import dolfinx.fem.petsc
import gmsh
import h5py
import matplotlib
import pyvista
import scipy
import tqdm
import ufl
from mpi4py import MPI
from petsc4py import PETSc

comm = MPI.COMM_WORLD
cube = dolfinx.mesh.create_unit_cube(comm, 2, 2, 2)
space = dolfinx.fem.functionspace(cube, ("Lagrange", 1))
mass = ufl.TrialFunction(space) * ufl.TestFunction(space) * ufl.dx
matrix = dolfinx.fem.petsc.assemble_matrix(dolfinx.fem.form(mass))
matrix.assemble()

solver = PETSc.KSP().create(comm)
solver.setOperators(matrix)
solver.setType("preonly")
solver.pc.setType("lu")
solver.pc.setFactorSolverType("mumps")
one, load = matrix.createVecs()
one.set(1.0)
matrix.mult(one, load)
if abs(load.sum() - 1.0) > 1e-12:
    raise RuntimeError("a compiled form gives a wrong volume")
solver.solve(load, one)
if abs(one.max()[1] - 1.0) > 1e-12:
    raise RuntimeError("MUMPS gives a wrong solution")

if comm.rank == 0:
    gmsh.initialize()
    gmsh.finalize()
    plotter = pyvista.Plotter(off_screen=True)
    plotter.add_mesh(pyvista.Cube())
    if plotter.screenshot(None).std() < 1.0:
        raise RuntimeError("VTK draws an empty picture")
    modules = (dolfinx, pyvista, h5py, matplotlib, scipy, tqdm)
    print(", ".join(f"{module.__name__} {module.__version__}" for module in modules))
