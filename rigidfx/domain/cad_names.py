"""The volumes and surfaces of a CAD file, a table of them, and which ones each name stands for."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
from rigidfx.base.types import Array
from rigidfx.domain.domain import KINDS

ROWS = 40  # of volumes and of surfaces in a message
CLOSE = 1e-6  # of the largest extent: gmsh's boxes are a little large
CALLED = {3: "volumes", 2: "surfaces"}


@dataclass(frozen=True)
class CadEntity:
    """A volume or a surface of a CAD file.

    Attributes:
        dim: 3 for a volume, 2 for a surface.
        number: Its number, the same whenever the file is read.
        label: Its label in the file, "" if it has none; gmsh reads those of parts, seldom those of
            faces.
        kind: "Volume", or the shape of the surface: "Plane", "Cylinder", "Torus" and so on;
            "Other surface" is one that gmsh does not name, such as an extruded spline.
        measure: Volume [m³] or area [m²].
        centre: Centre of mass, shape (3,) [m].
        lower: Least coordinates, shape (3,) [m].
        upper: Greatest coordinates, shape (3,) [m].
        normal: Outward unit normal of a plane, shape (3,); NaN for anything else.
        radius: Radius of a cylinder or a sphere [m], written as a spline or not; NaN for anything
            else.
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
        """Whether it lies in a box of corners with the least and the greatest coordinates [m]."""
        margin = CLOSE * float(np.max(self.upper - self.lower))
        above = (self.lower >= np.asarray(lower) - margin).all()
        return bool(above and (self.upper <= np.asarray(upper) + margin).all())

    def __str__(self) -> str:
        """One line with all that tells it from others."""
        extent = self.upper - self.lower
        flat = extent < CLOSE * extent.max()
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
        """The lines of the table of volumes (3), surfaces (2); all, or at most so many of each."""
        lines = []
        for dim in dims:
            rows = self.of(dim)
            lines += [f"{CALLED[dim].capitalize()}:", *map(str, rows[:most])]
            if most is not None and len(rows) > most:
                lines.append(f"       and {len(rows) - most} more; list_cad shows all.")
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.table()


Which = int | str | Callable[[CadEntity], bool] | Sequence[Any]


def named_volumes(
    cad: Cad, wanted: Mapping[str, Which] | None, out: set[int]
) -> dict[str, list[int]]:
    """Numbers of the volumes of each name, without those left out; all are "body" without names.

    Labels of the file are names, too. A name that picks nothing, and a volume without a name, are
    refused.
    """
    meshed = {v.number for v in cad.volumes} - out
    picked = _groups(cad, 3, {"body": sorted(meshed)} if wanted is None else wanted, meshed)
    missed = sorted(meshed.difference(*picked.values()))
    if missed:
        raise SceneError(
            f"read_cad: no name and no label stands for volume {', '.join(map(str, missed))}. "
            f"Name it, or leave it out (leave_out).\n{cad.table((3,), ROWS)}"
        )
    return picked


def named_surfaces(cad: Cad, wanted: Mapping[str, Which], out: set[int]) -> dict[str, list[int]]:
    """Numbers of the surfaces of each name that bound a volume in the mesh; none is refused."""
    picked = _groups(cad, 2, wanted, {s.number for s in cad.surfaces if set(s.volumes) - out})
    lost = [name for name in wanted if name not in picked]
    if lost:
        raise SceneError(
            f"read_cad: '{lost[0]}' picks only surfaces that bound no volume which is meshed "
            f"(leave_out?).\n{cad.table((2,), ROWS)}"
        )
    return picked


def _groups(
    cad: Cad, dim: int, wanted: Mapping[str, Which], meshed: set[int]
) -> dict[str, list[int]]:
    """Numbers of the entities in the mesh of each name that has some, labels of the file too."""
    groups: dict[str, list[int]] = {}
    for entity in cad.of(dim):
        if entity.label:
            groups.setdefault(entity.label, []).append(entity.number)
    groups |= {name: numbers_of(cad, dim, f"'{name}'", w) for name, w in wanted.items()}
    kept = {name: [n for n in own if n in meshed] for name, own in groups.items()}
    return {name: own for name, own in kept.items() if own}


def numbers_of(cad: Cad, dim: int, name: str, which: Which) -> list[int]:
    """Numbers of the entities that a name stands for; none is refused by that name."""
    each = [which] if isinstance(which, str) or not isinstance(which, Iterable) else list(which)
    found: set[int] = set()
    for one in each:
        is_number = isinstance(one, (int, np.integer)) and not isinstance(one, bool)
        if not (is_number or isinstance(one, str) or callable(one)):
            raise SceneError(
                f"read_cad: {name} must be a number, a label, a function of a CadEntity or a list "
                f"of these, got {shown(one)}."
            )
        matches = [e.number for e in cad.of(dim) if _picks(one, e, name)]
        if not matches:
            asked = f"{one!r}"
            if callable(one):
                kinds = ", ".join(sorted({f"'{e.kind}'" for e in cad.of(dim)}))
                asked = f"with its condition (kinds there: {kinds})"
            raise SceneError(
                f"read_cad: {name}: there are no {CALLED[dim]} {asked}, so no {KINDS[dim]} can "
                f"have this name.\n{cad.table((dim,), ROWS)}"
            )
        found |= set(matches)
    if not found:
        raise SceneError(f"read_cad: {name} picks nothing.\n{cad.table((dim,), ROWS)}")
    return sorted(found)


def _picks(one: Any, entity: CadEntity, name: str) -> bool:
    """Whether a label, a number or a condition picks an entity; `SceneError` if that fails."""
    if not callable(one):
        return bool(one == (entity.label if isinstance(one, str) else entity.number))
    try:
        return bool(one(entity))
    except Exception as error:  # whatever a user's function may raise
        raise SceneError(
            f"read_cad: the condition of {name} failed with {type(error).__name__}: {error}, at "
            f"{CALLED[entity.dim][:-1]} {entity.number} of kind '{entity.kind}'."
        ) from error
