"""The bodies found in a run as a multibody model: a file to read, and to start another run from.

The file is JSON: for each body its mass, inertia and pose, its cells by their numbers in the mesh
file, and the nodes at which flexible cells are attached to it; and joints as the scene has placed
them. Parts that a support clamps are not in it.
"""

import json
import re
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import dolfinx.mesh as dmesh
import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx import effects as fx
from rigidfx.base.errors import SceneError, together
from rigidfx.base.files import write_text
from rigidfx.base.inputs import numbers, path_of
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.coupling.dof_layout import nodes_of
from rigidfx.domain.domain import Domain, box_of
from rigidfx.report.report import Report
from rigidfx.report.start import check_report, check_scene
from rigidfx.scene.scene import Scene

FORMAT = "rigidfx bodies 2"
READ_ME = (
    "SI units. mass, centre, inertia (about the centre, in space), velocity and angular_velocity "
    "are those at time t; orientation is the rotation since the body became rigid. cells are "
    "numbered as in the mesh file, from 0; place is the mean of their middles in the reference "
    "shape. Row i of interface_nodes is where a node was in the reference shape; it is now at "
    "centre + orientation @ interface_offsets[i]. given: mass or inertia are not those of cells. "
    "joints have their places and axes at the start of the run."
)
KINDS: dict[str, type[fx.Joint]] = {
    kind.__name__: kind
    for kind in (fx.Cylindrical, fx.Prismatic, fx.Revolute, fx.Spherical, fx.Tied, fx.Universal)
}
FACES: dict[str, Any] = {face.__name__: face for face in (fx.MeanFace, fx.RigidFace)}


def joints_as_data(scene: Scene) -> list[dict[str, Any]]:
    """The joints of a scene for JSON: kind, sides, and places and axes at the start."""
    out = []
    for joint in scene.named(fx.Joint):
        data: dict[str, Any] = {"kind": joint.kind, "name": joint.title}
        for item in (f.name for f in fields(joint) if f.name != "name"):
            value = getattr(joint, item)
            if hasattr(value, "where"):
                value = {type(value).__name__: value.where}
            data[item] = value if isinstance(value, (str, dict)) else [float(x) for x in value]
        out.append(data)
    return out


def read_joints(path: str | Path) -> tuple[fx.Joint, ...]:
    """The joints of a file of `write_bodies`, as they were placed at the start.

    Sides are called as in the scene that wrote them: the mesh has to have their sets, and named
    parts are to be named again.

    Args:
        path: JSON file of `write_bodies`.

    Raises:
        SceneError: If the file cannot be read, or a joint in it is damaged.
    """
    path = path_of("read_joints", "path", path)
    try:
        given = json.loads(path.read_text(encoding="utf-8"))["joints"]
        return tuple(_joint(data) for data in given)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise SceneError(
            f"read_joints: '{path}' cannot be read as a file of write_bodies with joints: "
            f"{type(error).__name__}: {error}"
        ) from error


def _joint(data: dict[str, Any]) -> fx.Joint:
    own = dict(data)
    kind = KINDS[own.pop("kind")]
    for side in ("a", "b"):
        if isinstance(own[side], dict):
            ((face, where),) = own[side].items()
            own[side] = FACES[face](where)
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in own.items()}
    return kind(**values)


def write_bodies(path: str | Path, scene: Scene, report: Report) -> None:
    """Write the bodies of a report. Collective; rank 0 writes.

    Args:
        path: JSON file.
        scene: The problem.
        report: The last report of the run; bodies are those of its state.

    Raises:
        SceneError: If the report is none, of another scene, or the run has gone on since.
        OutputError: On every rank, if the file cannot be written.
    """
    check_scene("write_bodies", scene)

    def check() -> Path:
        check_report("write_bodies", scene, report)
        return path_of("write_bodies", "path", path)

    path = together(scene.comm, "write_bodies", check)
    state, comm = report.state, scene.comm
    numbers = np.asarray(scene.mesh.topology.original_cell_index)
    attached = _touching_flexible(scene, state.body_numbers())
    bodies = []
    for each in state.bodies:
        body, motion = each.data, each.motion
        if body.is_face:  # it belongs to its joint
            continue
        at = attached[body.nodes]
        interface = _sorted(comm, np.c_[state.X[body.nodes[at]], body.offsets[at]])
        bodies.append(
            {
                "name": body.name,
                "number": body.number,
                "given": body.given,
                "shapes": body.deforms_by,
                "mass": body.mass,
                "centre": motion.r.tolist(),
                "orientation": motion.R.tolist(),
                "inertia": (motion.R @ body.inertia @ motion.R.T).tolist(),
                "velocity": motion.velocity.tolist(),
                "angular_velocity": motion.angular_velocity.tolist(),
                "place": _place(scene.domain, body.cells).tolist(),
                "cells": _sorted(comm, numbers[body.cells]).tolist(),
                "interface_nodes": interface[:, :3].tolist(),
                "interface_offsets": interface[:, 3:].tolist(),
            }
        )
    content = {
        "format": FORMAT,
        "read_me": READ_ME,
        "t": report.t,
        "cells": int(scene.mesh.topology.index_map(3).size_global),
        "box": _box(scene.domain).tolist(),
        "bodies": bodies,
        "joints": joints_as_data(scene),
    }
    write_text(comm, path, _json(content))


def read_bodies(path: str | Path, domain: Domain) -> tuple[Domain, tuple[fx.Rigid, ...]]:
    """Bodies of a file as parts of the same mesh. Collective; every rank reads.

    Args:
        path: JSON file of `write_bodies`.
        domain: The mesh that the bodies were found on, from the same file or script.

    Returns:
        The domain with a set of cells for each body, and the effects that make them rigid, or
        `Reduced` where they have shapes, from the beginning. The sets have the bodies' names, but
        "part 2" is called "body 2" here, as parts may be found again, and a name that the domain
        has for other cells gets "found" behind it.

    Raises:
        SceneError: On every rank, if the file cannot be read or is of another mesh.
    """
    path = path_of("read_bodies", "path", path)
    if not isinstance(domain, Domain):
        raise SceneError(f"read_bodies: domain must be a Domain, got {type(domain).__name__}.")
    total, box = int(domain.mesh.topology.index_map(3).size_global), _box(domain)

    def read() -> list[dict[str, Any]]:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
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
    owned = domain.mesh.topology.index_map(3).size_local
    effects: list[fx.Rigid] = []
    taken: set[str] = set()
    for body in bodies:
        cells = np.flatnonzero(np.isin(numbers, body["cells"])).astype(np.int32)
        name = _free_name(body["name"], cells, domain, taken)
        taken.add(name)
        domain = domain.with_cell_set(name, cells)
        place = _place(domain, cells[cells < owned])
        if np.abs(place - body["place"]).max() > 1e-6 * np.ptp(box, axis=0).max():
            raise SceneError(
                f"read_bodies: '{path}' belongs to another mesh: the cells of '{body['name']}' "
                f"were around {body['place']} m, here they are around {place.tolist()} m."
            )
        own = _own_mass(body) if body["given"] else {}
        effects.append(fx.Reduced(name) if body.get("shapes") else fx.Rigid(name, **own))
    return domain, tuple(effects)


def _own_mass(body: dict[str, Any]) -> dict[str, Any]:
    """Mass and inertia, the latter in the body's frame, which is that of space at the start."""
    R, J = np.asarray(body["orientation"]), np.asarray(body["inertia"])
    inertia = R.T @ J @ R
    return {"mass": body["mass"], "inertia": (inertia + inertia.T) / 2}


def _free_name(name: str, cells: Indices, domain: Domain, taken: set[str]) -> str:
    """A name for a body's set of cells that does not stand for other cells. Collective."""
    name = re.sub(r"^part (?=\d+$)", "body ", name)
    while True:
        known = domain.sets.get((name, 3))
        other = known is not None and not np.array_equal(known.entities, cells)
        if name not in taken and not domain.comm.allreduce(other, op=MPI.LOR):
            return name
        name += " found"


def _place(domain: Domain, cells: Indices) -> Array:
    """Mean of the middles of owned cells in the reference shape, shape (3,) [m]. Collective."""
    middles = dmesh.compute_midpoints(domain.mesh, 3, cells).reshape(-1, 3)
    total = np.r_[middles.sum(axis=0), len(middles)]
    domain.comm.Allreduce(MPI.IN_PLACE, total)
    return np.asarray(total[:3] / total[3])


def _json(content: dict[str, Any]) -> str:
    """JSON with each list of numbers in one line, to be read by people too."""
    text = json.dumps(content, indent=1)
    return re.sub(r"\[[^][{}\"]*\]", lambda numbers: " ".join(numbers[0].split()), text) + "\n"


def _box(domain: Domain) -> Array:
    """Least and greatest coordinates of the mesh, shape (2, 3) [m]. Collective."""
    return np.array(box_of(domain.comm, domain.mesh.geometry.x))


def _checked(content: dict[str, Any], total: int, box: Array) -> list[dict[str, Any]]:
    """The bodies of a file if they are of this mesh, by its cells and box; else a `ValueError`."""
    if content["cells"] != total:
        raise ValueError(f"it belongs to a mesh of {content['cells']} cells, this has {total}.")
    theirs = np.asarray(content["box"], dtype=np.float64)
    if theirs.shape != (2, 3) or not np.abs(theirs - box).max() <= 1e-9 * np.ptp(box, axis=0).max():
        raise ValueError(f"it belongs to a mesh in {theirs.tolist()}, this is in {box.tolist()}.")
    names: list[Any] = []
    cells: list[int] = []
    for body in content["bodies"]:
        name, own = body["name"], body["cells"]
        if not isinstance(name, str) or not name or name in names:
            raise ValueError(f"the name {name!r} of a body is no text, or that of two.")
        _numbers(body)
        if not own or not all(isinstance(n, int) and 0 <= n < total for n in own):
            raise ValueError(f"body '{name}' has no cells, or cells that the mesh has not.")
        names.append(name)
        cells += own
    if len(set(cells)) < len(cells):
        raise ValueError("a cell is in two bodies, or twice in one.")
    return list(content["bodies"])


def _numbers(body: dict[str, Any]) -> None:
    """Check the numbers of a body: finite ones, a mass and a rotation; else a `ValueError`."""
    shapes = {"mass": (), "inertia": (3, 3), "orientation": (3, 3), "place": (3,)}
    for key, shape in shapes.items():
        value = numbers(body[key])
        if value.shape != shape or not np.isfinite(value).all():
            raise ValueError(f"{key} of body '{body['name']}' is {body[key]!r}.")
    if not body["mass"] > 0:
        raise ValueError(f"mass of body '{body['name']}' is {body['mass']!r}.")
    R = np.asarray(body["orientation"])
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0:
        raise ValueError(f"orientation of body '{body['name']}' is no rotation: {R.tolist()}.")
    if not isinstance(body["given"], bool):
        raise ValueError(f"given of body '{body['name']}' is {body['given']!r}.")


def _touching_flexible(scene: Scene, body_numbers: Indices) -> Bools:
    """For each owned node whether it belongs to a flexible cell. Collective."""
    owned = scene.mesh.topology.index_map(3).size_local
    cells = np.arange(owned, dtype=np.int32)[body_numbers == 0]
    return nodes_of(scene, {0: cells})[: scene.owned_nodes]


def _sorted(comm: Any, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Rows of all ranks in lexical order."""
    rows: Sequence[npt.NDArray[Any]] = comm.allgather(values)
    every = np.concatenate(rows)
    return np.unique(every, axis=0) if len(every) else every
