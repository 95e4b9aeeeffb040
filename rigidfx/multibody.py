"""The bodies found in a run as a multibody model: a file to read, and to start another run from.

The paper remarks that interim results show which simple multibody system a structure is. The file
is JSON: for each body its mass, inertia and pose, its cells by their numbers in the mesh file, and
the nodes at which flexible cells or loads can get hold of it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.domain import Domain
from rigidfx.effects import Rigid
from rigidfx.errors import OutputError, SceneError, agree, together
from rigidfx.partition import nodes_of
from rigidfx.report import Report
from rigidfx.scene import Scene

__all__ = ["read_bodies", "write_bodies"]

FORMAT = "rigidfx bodies 1"


def write_bodies(path: str | Path, scene: Scene, report: Report) -> None:
    """Write the bodies of a report. Collective; rank 0 writes.

    Args:
        path: JSON file.
        scene: The problem.
        report: The last report of the run; bodies are those of its state.

    Raises:
        OutputError: On every rank, if the file cannot be written.
    """
    state, comm = report.state, scene.comm
    numbers = np.asarray(scene.mesh.topology.original_cell_index)
    attached = _touching_flexible(scene, state.body_numbers())
    bodies = []
    for body, motion in zip(state.bodies, state.motions, strict=True):
        at = attached[body.nodes]
        nodes = state.X[body.nodes[at]]
        bodies.append(
            {
                "name": body.name,
                "number": body.number,
                "mass": body.mass,
                "centre": motion.r.tolist(),
                "orientation": motion.R.tolist(),
                "inertia": (motion.R @ body.inertia @ motion.R.T).tolist(),
                "velocity": motion.velocity.tolist(),
                "angular_velocity": motion.angular_velocity.tolist(),
                "cells": _sorted(comm, numbers[body.cells]).tolist(),
                "interface_nodes": _sorted(comm, nodes).tolist(),
            }
        )
    content = {
        "format": FORMAT,
        "units": "SI; inertia about the centre, in space; interface nodes in the reference shape",
        "t": report.t,
        "cells": int(scene.mesh.topology.index_map(3).size_global),
        "box": _box(scene.domain).tolist(),
        "bodies": bodies,
    }
    problem = None
    if comm.rank == 0:
        try:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            Path(path).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            problem = f"write_bodies: cannot write '{path}': {error.strerror or error}."
    agree(comm, problem, OutputError)


def read_bodies(path: str | Path, domain: Domain) -> tuple[Domain, tuple[Rigid, ...]]:
    """Bodies of a file as rigid parts of the same mesh. Collective; every rank reads.

    Args:
        path: JSON file of `write_bodies`.
        domain: The mesh that the bodies were found on, from the same file or script.

    Returns:
        The domain with a set of cells for each body, by the body's name, and the effects that make
        them rigid from the beginning.

    Raises:
        SceneError: On every rank, if the file cannot be read or is of another mesh.
    """
    total, box = int(domain.mesh.topology.index_map(3).size_global), _box(domain)

    def read() -> list[dict[str, Any]]:
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise SceneError(f"read_bodies: '{path}' cannot be read as JSON: {error}") from error
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise SceneError(f"read_bodies: '{path}' is no file of write_bodies.")
        try:
            return _checked(content, total, box)
        except ValueError as error:
            raise SceneError(f"read_bodies: '{path}': {error}") from error
        except (KeyError, TypeError) as error:
            raise SceneError(
                f"read_bodies: '{path}' is damaged: what write_bodies leaves there is missing or "
                f"of another kind ({type(error).__name__}: {error})."
            ) from error

    bodies = together(domain.comm, "read_bodies", read)
    numbers = np.asarray(domain.mesh.topology.original_cell_index)
    effects = []
    for body in bodies:
        cells = np.flatnonzero(np.isin(numbers, body["cells"]))
        domain = domain.with_cell_set(body["name"], cells.astype(np.int32))
        effects.append(Rigid(body["name"]))
    return domain, tuple(effects)


def _box(domain: Domain) -> npt.NDArray[np.float64]:
    """Least and greatest coordinates of the mesh, shape (2, 3) [m]. Collective."""
    x = domain.mesh.geometry.x
    ends = np.array([x.min(axis=0, initial=np.inf), -x.max(axis=0, initial=-np.inf)])
    domain.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MIN)
    lower, upper = ends
    return np.array([lower, -upper])


def _checked(
    content: dict[str, Any], total: int, box: npt.NDArray[np.float64]
) -> list[dict[str, Any]]:
    """The bodies of a file, if they are of this mesh.

    Args:
        content: What the file holds.
        total: Number of cells of the mesh.
        box: Its least and greatest coordinates, shape (2, 3) [m].

    Raises:
        ValueError: If something does not fit; the message says what.
    """
    if content["cells"] != total:
        raise ValueError(f"it belongs to a mesh of {content['cells']} cells, this has {total}.")
    theirs = np.asarray(content["box"], dtype=np.float64)
    if theirs.shape != (2, 3) or np.abs(theirs - box).max() > 1e-9 * np.ptp(box, axis=0).max():
        raise ValueError(f"it belongs to a mesh in {theirs.tolist()}, this is in {box.tolist()}.")
    names: list[Any] = []
    cells: list[int] = []
    for body in content["bodies"]:
        name, own = body["name"], body["cells"]
        if not isinstance(name, str) or name in names:
            raise ValueError(f"the name {name!r} of a body is no text, or that of two.")
        if not own or not all(isinstance(n, int) and 0 <= n < total for n in own):
            raise ValueError(f"body '{name}' has no cells, or cells that the mesh has not.")
        names.append(name)
        cells += own
    if len(set(cells)) < len(cells):
        raise ValueError("a cell is in two bodies.")
    return list(content["bodies"])


def _touching_flexible(scene: Scene, body_numbers: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
    """For each owned node whether it belongs to a flexible cell. Collective."""
    owned = scene.mesh.topology.index_map(3).size_local
    cells = np.arange(owned, dtype=np.int32)[body_numbers == 0]
    return nodes_of(scene, {0: cells})[: scene.owned_nodes]


def _sorted(comm: Any, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Rows of all ranks in lexical order."""
    rows: Sequence[npt.NDArray[Any]] = comm.allgather(values)
    every = np.concatenate(rows)
    return np.unique(every, axis=0) if len(every) else every
