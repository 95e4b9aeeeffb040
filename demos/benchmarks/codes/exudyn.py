"""Exudyn (J. Gerstmayr's multibody code), run by the Python that has it."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from bench import by_another_python
from scipy.sparse import csr_matrix

import rigidfx as rf
from rigidfx.vibration.problem import Problem

SCRIPT = Path(__file__).with_name("exudyn_steps.py")
Found = dict[str, npt.NDArray[Any]]


def exudyn(python: str, folder: Path, given: dict[str, Any]) -> Found:
    """Let the Python that has Exudyn take steps, by the names that `exudyn_steps.py` reads.

    It raises a `RuntimeError` if there is no result.
    """
    folder.mkdir(parents=True, exist_ok=True)
    asked = folder / "given.npz"
    np.savez(asked, **given)
    found = by_another_python(python, SCRIPT, asked, folder / "found.npz")
    if isinstance(found, str):
        raise RuntimeError(f"Exudyn: {found}")
    return found


def matrices(scene: rf.Scene) -> tuple[csr_matrix, csr_matrix]:
    """Mass [kg] and stiffness at rest [N/m] of a scene's dofs, without its effects; on one rank."""
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", message=".*touches, or overlaps", category=rf.RigidfxWarning
        )
        material = scene.materials[0][0]
        bare = rf.Scene(scene.domain, material, [], order=scene.order, mass="consistent")
    problem = Problem(bare)
    count = problem.K.getSize()[0]
    y = problem.K.createVecRight()
    y.array[:] = np.arange(count)
    unknown_of = problem.seen(y)[0].reshape(-1).astype(int)
    y.destroy()
    out = []
    for matrix in (problem.M, problem.K):
        whole = matrix.convert("aij")
        start, columns, values = whole.getValuesCSR()
        csr = csr_matrix((values, columns, start), shape=(count, count))
        out.append(csr[unknown_of][:, unknown_of])
    problem.destroy()
    return out[0], out[1]


def part_of(
    name: str,
    scene: rf.Scene,
    faces: tuple[str, str],
    pins: npt.ArrayLike,
    probes: npt.NDArray[np.int64],
    both: tuple[csr_matrix, csr_matrix],
) -> Found:
    """A flexible part as `exudyn_steps.py` reads it, by its name and two mean faces.

    Pins are places of joints in them, the first one its frame's origin, shape (2, 3) [m]; probes
    are nodes; `both` are mass and stiffness of the scene.
    """
    cells = scene.domain.find(name, [3], "Exudyn").entities
    nodes = np.unique(scene.space.dofmap.list[cells])
    X = scene.space.tabulate_dof_coordinates()
    rows = (3 * nodes[:, None] + np.arange(3)).reshape(-1)
    out: dict[str, Any] = {
        "points": X[nodes],
        "probes": np.searchsorted(nodes, probes),
        "pins": pins,
    }
    for kind, matrix in zip(("mass", "stiffness"), both, strict=True):
        own = csr_matrix(matrix[rows][:, rows])
        assert own.nnz == matrix[rows].nnz, "the part is joined to others by its matrices"
        for key in ("data", "indices", "indptr"):
            out[f"{kind} {key}"] = getattr(own, key)
    for k, face in enumerate(faces):
        weights = scene.facet_weights(face, "Exudyn")[nodes]
        held = np.flatnonzero(np.abs(weights) > 1e-12 * np.abs(weights).max())
        out[f"face {k}"], out[f"weights {k}"] = held, weights[held] / weights.sum()
    return {f"{name} {key}": np.asarray(value) for key, value in out.items()}
