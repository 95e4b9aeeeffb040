"""The environment of processes that a benchmark starts."""

import os

__all__ = ["without_mpi"]

MINE = "OMPI_COMM", "OMPI_UNIVERSE", "PMIX_", "PMI_", "PRTE_", "HYDRA_"  # of this process in MPI


def without_mpi() -> dict[str, str]:
    """The variables that another program of MPI may see: mpirun knows of no other process here."""
    return {name: value for name, value in os.environ.items() if not name.startswith(MINE)}
