"""Read CAD (STEP, IGES, BREP): find volumes and surfaces, name them, mesh them.

CAD files know no physical names. The volumes and surfaces of a file are listed with their numbers,
labels, places and shapes; names are then given by number, by label, or by a condition on these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.base.errors import SceneError, together
from rigidfx.base.inputs import number, positive
from rigidfx.domain.domain import KINDS, Domain
from rigidfx.domain.gmsh_model import domain_of, find_file, gmsh_session
from rigidfx.domain.gmsh_script import check_order, mesh_model

__all__ = ["Cad", "CadEntity", "Which", "list_cad", "read_cad"]

Array = npt.NDArray[np.float64]

ROWS = 40  # of volumes and of surfaces in a message
CELLS = 20  # along the diagonal of the geometry, where no size is given
CALLED = {3: "volumes", 2: "surfaces"}


@dataclass(frozen=True)
class CadEntity:
    """A volume or a surface of a CAD file.

    Attributes:
        dim: 3 for a volume, 2 for a surface.
        number: Its number, the same whenever the file is read.
        label: Its label in the file, "" if it has none; gmsh reads those of parts, seldom those of
            faces.
        kind: "Volume", or the shape of the surface: "Plane", "Cylinder", "Torus" and so on.
        measure: Volume [m³] or area [m²].
        centre: Centre of mass, shape (3,) [m].
        lower: Least coordinates, shape (3,) [m].
        upper: Greatest coordinates, shape (3,) [m].
        normal: Outward unit normal of a plane, shape (3,); NaN for anything else.
        radius: Radius of a cylinder or a sphere [m]; NaN for anything else.
        volumes: Numbers of the volumes that a surface bounds: two where they are glued.
    """

    dim: int
    number: int
    label: str
    kind: str
    measure: float
    centre: Array
    lower: Array
    upper: Array
    normal: Array
    radius: float
    volumes: tuple[int, ...]

    def within(self, lower: Sequence[float], upper: Sequence[float]) -> bool:
        """Whether it lies in a box.

        Args:
            lower: Corner with the least coordinates [m].
            upper: Opposite corner [m].
        """
        margin = 1e-6 * float(np.max(self.upper - self.lower))  # gmsh's boxes are a little large
        inside = (self.lower >= np.asarray(lower) - margin) & (
            self.upper <= np.asarray(upper) + margin
        )
        return bool(inside.all())

    def __str__(self) -> str:
        """One line with all that tells it from others."""
        extent = self.upper - self.lower
        flat = extent < 1e-6 * extent.max()
        box = " × ".join(f"{x:.4g}" for x in np.where(flat, 0.0, extent))
        shape = f"{self.measure:.4g} m³" if self.dim == 3 else f"{self.measure:.4g} m²"
        if np.isfinite(self.normal).all():
            shape += f", normal {_triple(self.normal)}"
        if np.isfinite(self.radius):
            shape += f", radius {self.radius:.4g} m"
        if self.volumes:
            shape += ", of volume " + " and ".join(map(str, self.volumes))
        label = f" '{self.label}'" if self.label else ""
        return f"{self.number:5d}  {self.kind}{label} at {_triple(self.centre)} m, {box} m, {shape}"


def _triple(x: Array) -> str:
    return "(" + ", ".join(f"{v:.4g}" for v in np.round(x, 9) + 0.0) + ")"


@dataclass(frozen=True)
class Cad:
    """The contents of a CAD file; printed, a table.

    Attributes:
        volumes: The volumes by increasing number.
        surfaces: The surfaces by increasing number.
    """

    volumes: tuple[CadEntity, ...]
    surfaces: tuple[CadEntity, ...]

    def of(self, dim: int) -> tuple[CadEntity, ...]:
        """The volumes (3) or the surfaces (2)."""
        return self.volumes if dim == 3 else self.surfaces

    @property
    def size(self) -> float:
        """Diagonal of the box around everything [m]."""
        lower = np.min([v.lower for v in self.volumes], axis=0)
        upper = np.max([v.upper for v in self.volumes], axis=0)
        return float(np.linalg.norm(upper - lower))

    def table(self, dims: Iterable[int] = (3, 2), most: int | None = None) -> str:
        """The lines of the table.

        Args:
            dims: 3 for volumes, 2 for surfaces.
            most: Most lines of each; all if None.
        """
        lines = []
        for dim in dims:
            rows = self.of(dim)
            lines += [f"{CALLED[dim].capitalize()}:", *map(str, rows[:most])]
            if most is not None and len(rows) > most:
                lines.append(f"       and {len(rows) - most} more; list_cad shows all.")
        return "\n".join(lines)

    def __str__(self) -> str:
        """The whole table."""
        return self.table()


Which = int | str | Callable[[CadEntity], bool] | Sequence[Any]


def list_cad(
    path: str | Path,
    *,
    scale: float = 1.0,
    glue: bool = True,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> Cad:
    """List the volumes and surfaces of a CAD file: numbers, labels, places, shapes. Collective.

    Example:
        >>> print(list_cad("arm.step"))                       # doctest: +SKIP

    Args:
        path: A STEP, IGES or BREP file; it is read on rank 0 only.
        scale: As in `read_cad`.
        glue: As in `read_cad`.
        comm: Ranks that call this.

    Raises:
        SceneError: If the file is missing or unreadable, or holds no volume.
    """
    metres = _metres(path, positive("list_cad", "scale", scale))

    def read() -> Cad | None:
        if comm.rank > 0:
            return None
        with gmsh_session() as gmsh:
            return _open(gmsh, path, metres, glue)

    cad: Cad = comm.bcast(together(comm, f"gmsh: reading '{path}'", read))
    return cad


def read_cad(
    path: str | Path,
    *,
    volumes: Mapping[str, Which] | None = None,
    surfaces: Mapping[str, Which] | None = None,
    leave_out: Which = (),
    size: float | None = None,
    per_circle: float = 0.0,
    order: int = 1,
    scale: float = 1.0,
    glue: bool = True,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> Domain:
    """Mesh a CAD file by tetrahedra. Collective.

    A name stands for what its value picks: a number, a label of the file, a function that is True
    for the right `CadEntity`, or a list of these. `list_cad` shows the choice.
    Labels of the file are names as well, unless a name given here is the same.

    Example:
        >>> domain = read_cad(                                # doctest: +SKIP
        ...     "arm.step",
        ...     surfaces={
        ...         "bolts": lambda s: s.kind == "Cylinder" and s.radius < 0.004,
        ...         "end": lambda s: s.normal[0] > 0.99,
        ...         "seat": [3, 4],
    ...         "motor": lambda s: s.volumes == (2,),
        ...         "grip": lambda s: s.within((0.2, -1, -1), (0.3, 1, 1)),
        ...     },
        ...     size=0.008,
        ... )

    Args:
        path: A STEP, IGES or BREP file; it is read on rank 0 only.
        volumes: Names of cells and which volumes they stand for; every volume has to be in one.
            All volumes are named "body" if None.
        surfaces: Names of facets and which surfaces they stand for.
        leave_out: Volumes that are not meshed.
        size: Largest edge of a cell [m]; a twentieth of the diagonal of the geometry if None.
        per_circle: Least number of cells around a full circle of a curved face; with 0 curvature
            does not count.
        order: Order of the cells' geometry: 1, or 2 for cells as curved as the surfaces.
        scale: Factor of all lengths. The unit of a STEP or IGES file is read from it, so that 1 is
            right; a BREP file has none and takes metres per unit.
        glue: Whether volumes that touch share the cells' nodes there; otherwise they are separate
            bodies that do not feel each other.
        comm: Communicator of the mesh.

    Raises:
        SceneError: If the file is missing, unreadable, without volumes or cannot be meshed; if a
            name picks nothing or a volume has no name. The message lists the choice.
    """
    metres = _metres(path, positive("read_cad", "scale", scale))
    largest = None if size is None else positive("read_cad", "size", size)
    if not number("read_cad", "per_circle", per_circle) >= 0:
        raise SceneError(f"read_cad: per_circle must be ≥ 0, got {per_circle!r}.")
    check_order("read_cad", order)
    for called, wanted in (("volumes", volumes), ("surfaces", surfaces)):
        if not (wanted is None or isinstance(wanted, Mapping)) or not all(
            isinstance(name, str) and name for name in wanted or ()
        ):
            raise SceneError(
                f"read_cad: {called} must be a dict of names to numbers, labels, functions of a "
                f"CadEntity or lists of these, such as {{'end': [3, 4]}}; got {wanted!r}."
            )

    def fill(gmsh: Any) -> None:
        cad = _open(gmsh, path, metres, glue)
        if largest is not None and largest > cad.size:
            raise SceneError(
                f"read_cad: the size {largest:g} m is larger than all of '{path}', "
                f"{cad.size:.3g} m. Is the unit right (scale)?"
            )
        nothing = isinstance(leave_out, Sequence) and not leave_out
        out = set() if nothing else set(_numbers(cad, 3, "leave_out", leave_out))
        gmsh.model.removeEntities([(3, tag) for tag in out])
        groups = {3: _volumes(cad, volumes, out), 2: _surfaces(cad, surfaces or {}, out)}
        for dim, named in groups.items():
            for name, tags in named.items():
                gmsh.model.addPhysicalGroup(dim, tags, name=name)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", per_circle)
        mesh_model(gmsh, (cad.size / CELLS if largest is None else largest) / metres, order)

    return domain_of(comm, f"gmsh: '{path}'", f"'{path}'", fill, metres)


# Reading ----------------------------------------------------------------------------------------


def _metres(path: str | Path, scale: float) -> float:
    """Metres per unit of length of the model that a file becomes.

    OpenCASCADE's tolerances are lengths that suit millimetres: files with a unit are converted to
    these.
    """
    return scale if Path(path).suffix.lower() == ".brep" else 1e-3 * scale


def _open(gmsh: Any, path: str | Path, metres: float, glue: bool) -> Cad:
    """Import a file into a new model, whose unit of length is given in metres."""
    find_file(path, "CAD")
    model, occ = gmsh.model, gmsh.model.occ
    model.add("rigidfx")
    unit = gmsh.option.getString("Geometry.OCCTargetUnit")
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
    occ.importShapes(str(path))
    gmsh.option.setString("Geometry.OCCTargetUnit", unit)
    occ.synchronize()
    if not model.getEntities(3):
        raise SceneError(
            f"'{path}' holds no volume, only {len(model.getEntities(2))} surfaces. Export a solid."
        )
    labels = {entity: model.getEntityName(*entity) for entity in model.getEntities()}
    if glue and len(model.getEntities(3)) > 1:
        labels = _glue(gmsh, labels)
    return Cad(
        *(
            tuple(_entity(gmsh, dim, tag, labels, metres) for _, tag in model.getEntities(dim))
            for dim in (3, 2)
        )
    )


def _glue(gmsh: Any, labels: Mapping[tuple[int, int], str]) -> dict[tuple[int, int], str]:
    """Make volumes share the faces at which they touch; labels go over to the pieces."""
    volumes = gmsh.model.getEntities(3)
    labelled = [(dim, tag) for (dim, tag), label in labels.items() if dim == 2 and label]
    parents = [*volumes, *labelled]
    _, pieces = gmsh.model.occ.fragment(parents, [])
    gmsh.model.occ.synchronize()
    return {
        piece: labels[parent]
        for parent, of_parent in reversed(list(zip(parents, pieces, strict=True)))
        for piece in of_parent
    }


def _entity(
    gmsh: Any, dim: int, tag: int, labels: Mapping[tuple[int, int], str], metres: float
) -> CadEntity:
    """An entity with all its properties."""
    model = gmsh.model
    normal: Array = np.full(3, np.nan)
    radius, kind = float("nan"), "Volume"
    if dim == 2:
        kind = model.getType(dim, tag)
        ends = model.getParametrizationBounds(dim, tag)
        middle = [(a + b) / 2 for a, b in zip(*ends, strict=True)]
        if kind == "Plane":
            normal = np.asarray(model.getNormal(tag, middle))
        if kind in ("Cylinder", "Sphere"):
            radius = metres / float(model.getCurvature(dim, tag, middle)[0])
    box: Array = metres * np.reshape(model.getBoundingBox(dim, tag), (2, 3))
    return CadEntity(
        dim,
        tag,
        labels.get((dim, tag), "").split("/")[-1],
        kind,
        metres**dim * float(model.occ.getMass(dim, tag)),
        metres * np.asarray(model.occ.getCenterOfMass(dim, tag)),
        box[0],
        box[1],
        normal,
        radius,
        tuple(sorted(model.getAdjacencies(dim, tag)[0].tolist())) if dim == 2 else (),
    )


# Names ------------------------------------------------------------------------------------------


def _volumes(cad: Cad, wanted: Mapping[str, Which] | None, out: set[int]) -> dict[str, list[int]]:
    """Numbers of the volumes of each name, without those left out."""
    inside = [v.number for v in cad.volumes if v.number not in out]
    picked = _groups(cad, 3, {"body": inside} if wanted is None else wanted)
    named = {n for name in wanted or ["body"] for n in picked[name]}
    missed = sorted(set(inside) - named)
    if missed:
        raise SceneError(
            f"read_cad: no name stands for volume {', '.join(map(str, missed))}. Name it, or leave "
            f"it out (leave_out).\n{cad.table((3,), ROWS)}"
        )
    kept = {name: [n for n in own if n not in out] for name, own in picked.items()}
    return {name: own for name, own in kept.items() if own}


def _surfaces(cad: Cad, wanted: Mapping[str, Which], out: set[int]) -> dict[str, list[int]]:
    """Numbers of the surfaces of each name that bound a volume which is not left out."""
    bounding = {s.number for s in cad.surfaces if set(s.volumes) - out}
    picked = _groups(cad, 2, wanted)
    kept = {name: [n for n in own if n in bounding] for name, own in picked.items()}
    lost = [name for name in wanted if not kept[name]]
    if lost:
        raise SceneError(
            f"read_cad: '{lost[0]}' picks only surfaces that bound no volume which is meshed "
            f"(leave_out?).\n{cad.table((2,), ROWS)}"
        )
    return {name: own for name, own in kept.items() if own}


def _groups(cad: Cad, dim: int, wanted: Mapping[str, Which]) -> dict[str, list[int]]:
    """Numbers of the entities of each name, labels of the file among the names."""
    groups: dict[str, list[int]] = {}
    for entity in cad.of(dim):
        if entity.label:
            groups.setdefault(entity.label, []).append(entity.number)
    return groups | {name: _numbers(cad, dim, f"'{name}'", w) for name, w in wanted.items()}


def _numbers(cad: Cad, dim: int, name: str, which: Which) -> list[int]:
    """Numbers of the entities that a name stands for."""
    each = [which] if isinstance(which, str) or not isinstance(which, Iterable) else list(which)
    found: set[int] = set()
    for one in each:
        if isinstance(one, str):
            matches = [e.number for e in cad.of(dim) if e.label == one]
        elif callable(one):
            matches = [e.number for e in cad.of(dim) if one(e)]
        elif isinstance(one, (int, np.integer)) and not isinstance(one, bool):
            matches = [e.number for e in cad.of(dim) if e.number == one]
        else:
            raise SceneError(
                f"read_cad: {name} must be a number, a label, a function of a CadEntity or a list "
                f"of these, got {one!r}."
            )
        if not matches:
            asked = "with its condition" if callable(one) else f"{one!r}"
            raise SceneError(
                f"read_cad: {name}: there are no {CALLED[dim]} {asked}, so no {KINDS[dim]} can "
                f"have this name.\n{cad.table((dim,), ROWS)}"
            )
        found |= set(matches)
    if not found:
        raise SceneError(f"read_cad: {name} picks nothing.\n{cad.table((dim,), ROWS)}")
    return sorted(found)
