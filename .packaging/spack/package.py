"""Recipe for Spack: a folder py_rigidfx of a repository's packages takes this file."""

from spack.package import *
from spack_repo.builtin.build_systems.python import PythonPackage


class PyRigidfx(PythonPackage):
    """Structural dynamics in which only what deforms is computed as flexible, on DOLFINx."""

    homepage = "https://github.com/rigidfx/rigidfx"
    git = "https://github.com/rigidfx/rigidfx.git"

    license("MIT")
    version("0.2.0", tag="v0.2.0")

    depends_on("python@3.10:", type=("build", "run"))
    depends_on("py-setuptools@77:", type="build")

    depends_on("py-fenics-dolfinx@0.9:0.11+petsc4py+slepc4py", type="run")
    depends_on("petsc~complex+mumps", type="run")
    depends_on("py-mpi4py", type="run")
    depends_on("py-gmsh", type="run")
    depends_on("py-h5py", type="run")
    depends_on("py-matplotlib", type="run")
    depends_on("py-numpy", type="run")
    depends_on("py-scipy", type="run")
    depends_on("py-tqdm", type="run")
