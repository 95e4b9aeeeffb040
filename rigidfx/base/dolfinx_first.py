"""Makes DOLFINx ready to be imported, or names the packages to install; imported first.

DOLFINx of the wheel `dolfinx-solver-real` can be imported once its module `dolfinx_solver` has
loaded the MPI library that all its parts share. DOLFINx from elsewhere needs no such thing.
"""

from importlib.util import find_spec

NEEDED = "dolfinx", "petsc4py", "mpi4py"


def prepare() -> None:
    """Import the modules that come before DOLFINx; raise `ModuleNotFoundError` without it."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise ModuleNotFoundError(
            f"rigidfx needs DOLFINx 0.9 to 0.11, petsc4py and mpi4py, but {' and '.join(missing)} "
            "cannot be found: 'pip install dolfinx-solver-real' installs all of them (Linux on "
            "x86-64, Python 3.12 or newer), and so do 'apt install python3-dolfinx-real' (Debian "
            "13) and 'conda install -c conda-forge fenics-dolfinx'.",
            name=missing[0],
        )
    if find_spec("dolfinx_solver") is not None:
        import dolfinx_solver  # noqa: F401


prepare()
