"""Read CAD (STEP, IGES, BREP): find volumes and surfaces, name them, mesh them.

Names are given by number, by label, or by a condition on places and shapes. OpenCASCADE reads a
file in UTF-8, in silence, and ends Python over some STEP files that were cut short. Labels are the
names of parts: gmsh joins the names of assemblies, their pieces and parts by "/", as in
"Shapes/machine/3/M8/20". The part's name is the last of them, but for names that have a "/"
themselves; these are in the file.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import SceneError, together
from rigidfx.base.files import decoded
from rigidfx.base.inputs import number, path_of, positive, shown
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.domain.cad_names import (
    Cad,
    CadEntity,
    Which,
    named_surfaces,
    named_volumes,
    numbers_of,
)
from rigidfx.domain.cell_quality import volume
from rigidfx.domain.domain import Domain
from rigidfx.domain.gmsh_groups import name_of
from rigidfx.domain.gmsh_model import domain_of, find_file, gmsh_session, silent
from rigidfx.domain.gmsh_script import check_order, mesh_model

EVEN = 1e-5  # relative: what is constant; of a surface's size over its radius: what is flat
LOST = 0.01  # of the volume: more than that is told
CELLS = 20  # along the diagonal of the geometry, where no size is given
# Letters that STEP writes in other ways: X2, X4 and X by numbers, S by another one, ' twice.
ESCAPE = r"\\X[24]\\[0-9A-F]*\\X0\\|\\X\\[0-9A-F]{2}|\\S\\.|\\P[A-I]\\|''|\\\\"


def labels_of(gmsh: Any, text: str) -> dict[tuple[int, int], str]:
    """Labels of entities of gmsh's model by dimension and number, from a text; "" if none."""
    model = gmsh.model
    given = {each: name_of(model.getEntityName, *each) for each in model.getEntities()}
    if not any(given.values()):
        return given
    strings = re.findall(r"'((?:[^'/]|'')*/(?:[^']|'')*)'", text)
    with_slash = [
        re.compile("/(" + ".+?".join(map(re.escape, re.split(ESCAPE, each))) + ")$", re.DOTALL)
        for each in sorted(set(strings), key=len, reverse=True)
    ]
    return {each: _last(name, with_slash) for each, name in given.items()}


def _last(name: str, with_slash: list[re.Pattern[str]]) -> str:
    """The last of the names that are joined."""
    found = (match[1] for each in with_slash if (match := each.search(name)))
    return next(found, name.split("/")[-1])


def import_shapes(gmsh: Any, path: str | Path) -> dict[tuple[int, int], str]:
    """Add the shapes of a STEP, IGES or BREP file; their labels by dimension and number.

    `SceneError` if a STEP file is not whole.
    """
    data = Path(path).read_bytes()
    text = decoded(data)
    if Path(path).suffix.lower() in (".step", ".stp"):
        _check_whole(path, text)
    with TemporaryDirectory() as folder, silent():
        copy = Path(path)
        if not (text.isascii() or text.encode() == data):  # OpenCASCADE would mix letters up
            copy = Path(folder, copy.name)
            copy.write_bytes(text.encode())
        gmsh.model.occ.importShapes(str(copy))
        gmsh.model.occ.synchronize()
    return labels_of(gmsh, text)


def _check_whole(path: str | Path, text: str) -> None:
    """Refuse a STEP file that names entities that it has not."""
    plain = re.sub(r"'(?:[^']|'')*'|/\*.*?\*/", "", text, flags=re.DOTALL)
    there = set(re.findall(r"#(\d+)\s*=", plain))
    lost = set(re.findall(r"#(\d+)", plain)) - there
    if lost:
        raise SceneError(
            f"'{path}' is damaged: it names entities that are not in it, such as "
            f"#{min(lost, key=int)}. Export it once more."
        )


def list_cad(
    path: str | Path, *, scale: float = 1.0, glue: bool = True, comm: MPI.Intracomm = MPI.COMM_WORLD
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
    path = path_of("list_cad", "path", path)
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

    A name stands for the choice of its value: a number, a label of the file, a function that is
    True for the right `CadEntity`, or a list of these. `list_cad` shows the choice. Labels of the
    file are names as well, unless a name given here is the same.

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
        volumes: Names of cells and which volumes they stand for, besides the labels of the file;
            every volume has to be in one. All volumes are named "body" if None.
        surfaces: Names of facets and which surfaces they stand for.
        leave_out: Volumes that are not meshed.
        size: Largest edge of a cell [m]. gmsh makes none longer than a tenth of the diagonal of the
            geometry. A twentieth of that if None.
        per_circle: Number of cells around a full circle, which sets their size along all curved
            faces where `size` is larger. With 0 only cylinders and spheres are refined, to at least
            twelve edges around them. A warning says if more than 1 % of the volume is lost.
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
    path = path_of("read_cad", "path", path)
    metres = _metres(path, positive("read_cad", "scale", scale))
    largest = None if size is None else positive("read_cad", "size", size)
    if not number("read_cad", "per_circle", per_circle) >= 0:
        raise SceneError(f"read_cad: per_circle must be ≥ 0, got {shown(per_circle)}.")
    check_order("read_cad", order)
    _check_wanted("volumes", volumes)
    _check_wanted("surfaces", surfaces)

    exact: list[float] = []  # volumes that are meshed [m³]

    def fill(gmsh: Any, notes: list[str]) -> None:
        cad = _open(gmsh, path, metres, glue)
        out = _name(gmsh, cad, volumes, surfaces or {}, leave_out)
        exact.extend(v.measure for v in cad.volumes if v.number not in out)
        if largest is not None and largest > cad.size:
            raise SceneError(
                f"read_cad: the size {largest:g} m is larger than all of '{path}', "
                f"{cad.size:.3g} m. Is the unit right (scale)?"
            )
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", per_circle)
        length = cad.size / CELLS if largest is None else largest
        if not per_circle:
            _refine_circles(gmsh, cad, length, metres)
        told = mesh_model(gmsh, path, length / metres, order, metres)
        notes += [f"read_cad: '{path}': {text}" for text in told]

    domain = domain_of(comm, f"gmsh: '{path}'", f"'{path}'", fill, metres)
    _tell_lost(domain, comm.bcast(sum(exact)), order)
    return domain


def _refine_circles(gmsh: Any, cad: Cad, length: float, metres: float) -> None:
    """Ask for twelve sides around cylinders and spheres; small holes had six, or four as splines.

    Cells have edges of a largest `length` [m], of `metres` per unit of the model.
    """
    there = set(gmsh.model.getEntities(2))
    round_ = [s for s in cad.surfaces if np.isfinite(s.radius) and (2, s.number) in there]
    for surface in sorted(round_, key=lambda s: -s.radius):  # the smallest one has the last word
        side = 2 * np.pi * surface.radius / 12
        if side < length:
            ends = gmsh.model.getBoundary([(2, surface.number)], False, False, True)
            gmsh.model.mesh.setSize([end for end in ends if end[0] == 0], side / metres)


def _tell_lost(domain: Domain, exact: float, order: int) -> None:
    """Warn where cells have another volume, and so another mass, than the geometry. Collective."""
    meshed = volume(domain.mesh)
    off = meshed / exact - 1
    curved = ", curved ones (order=2)" if order == 1 else ""
    if abs(off) > LOST:
        warn(
            domain.comm,
            f"read_cad: the cells have {meshed:.4g} m³ where the geometry has {exact:.4g} m³: "
            f"{abs(off):.1%} {'more' if off > 0 else 'less'} mass. Nearer are smaller cells "
            f"(size), more of them around curves (per_circle=16){curved}.",
        )


def _name(
    gmsh: Any,
    cad: Cad,
    volumes: Mapping[str, Which] | None,
    surfaces: Mapping[str, Which],
    leave_out: Which,
) -> set[int]:
    """Leave volumes out, and make physical groups of named entities; the numbers left out."""
    nothing = isinstance(leave_out, Sequence) and not leave_out
    out = set() if nothing else set(numbers_of(cad, 3, "leave_out", leave_out))
    gmsh.model.removeEntities([(3, tag) for tag in out])
    groups = {3: named_volumes(cad, volumes, out), 2: named_surfaces(cad, surfaces, out)}
    for dim, named in groups.items():
        for name, tags in named.items():
            gmsh.model.addPhysicalGroup(dim, tags, name=name)
    return out


def _check_wanted(called: str, wanted: object) -> None:
    """Refuse anything but a dict of names; their values are looked at in the file."""
    if wanted is None:
        return
    if not isinstance(wanted, Mapping) or not all(
        isinstance(name, str) and name for name in wanted
    ):
        raise SceneError(
            f"read_cad: {called} must be a dict of names to numbers, labels, functions of a "
            f"CadEntity or lists of these, such as {{'end': [3, 4]}}; got {shown(wanted)}."
        )


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
    model = gmsh.model
    model.add("rigidfx")
    gmsh.option.setNumber("Geometry.OCCBoundsUseStl", 1)  # others are those of splines' poles
    unit = gmsh.option.getString("Geometry.OCCTargetUnit")
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
    labels = import_shapes(gmsh, path)
    gmsh.option.setString("Geometry.OCCTargetUnit", unit)
    if not model.getEntities(3):
        raise SceneError(
            f"'{path}' holds no volume, only {len(model.getEntities(2))} surfaces. Export a solid."
        )
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
    kind = "Volume" if dim == 3 else model.getType(dim, tag).replace("Unknown", "Other surface")
    normal, radius = (np.full(3, np.nan), float("nan")) if dim == 3 else _shape(gmsh, tag)
    box: Array = metres * np.reshape(model.getBoundingBox(dim, tag), (2, 3))
    return CadEntity(
        dim,
        tag,
        labels.get((dim, tag), ""),
        kind,
        metres**dim * float(model.occ.getMass(dim, tag)),
        metres * np.asarray(model.occ.getCenterOfMass(dim, tag)),
        box[0],
        box[1],
        normal,
        metres * radius,
        tuple(sorted(model.getAdjacencies(dim, tag)[0].tolist())) if dim == 2 else (),
    )


def _shape(gmsh: Any, tag: int) -> tuple[Array, float]:
    """Outward normal of a plane and radius of a cylinder or a sphere; NaN of anything else.

    Curvature tells, whatever kind of surface the file has: programs write splines for all.
    """
    model = gmsh.model
    box = np.reshape(model.getBoundingBox(2, tag), (2, 3))
    size = float(np.linalg.norm(box[1] - box[0]))
    lower, upper = model.getParametrizationBounds(2, tag)
    places = np.linspace(lower, upper, 5)[1:-1]  # in the middle a surface has no poles
    grid = np.array([(p[0], q[1]) for p in places for q in places]).ravel()
    curvature = np.abs(np.stack(model.getPrincipalCurvatures(tag, grid)[:2])) * size
    least, most = np.sort(curvature, axis=0)
    if most.max() < EVEN:
        return np.asarray(model.getNormal(tag, places[1])), float("nan")
    even = np.ptp(most) <= EVEN * most.max()
    round_ = least.max() <= EVEN * most.max() or np.allclose(least, most, rtol=EVEN)
    return np.full(3, np.nan), size / float(most.mean()) if even and round_ else float("nan")
