"""Names for the content of a CAD file: which volumes and surfaces each of them stands for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
from rigidfx.domain.cad_entities import CALLED, Cad, CadEntity, Which
from rigidfx.domain.domain import KINDS

__all__ = ["named_surfaces", "named_volumes", "numbers_of"]

ROWS = 40  # of volumes and of surfaces in a message


def named_volumes(
    cad: Cad, wanted: Mapping[str, Which] | None, out: set[int]
) -> dict[str, list[int]]:
    """Numbers of the volumes of each name, without those left out.

    Args:
        cad: The content of the file.
        wanted: The choice of each name, besides the labels of the file; all volumes are named
            "body" if None.
        out: Numbers of volumes that are left out.

    Raises:
        SceneError: If a name picks nothing, or neither a name nor a label stands for a volume.
    """
    inside = [v.number for v in cad.volumes if v.number not in out]
    picked = _groups(cad, 3, {"body": inside} if wanted is None else wanted)
    named = {n for own in picked.values() for n in own}
    missed = sorted(set(inside) - named)
    if missed:
        raise SceneError(
            f"read_cad: no name and no label stands for volume {', '.join(map(str, missed))}. "
            f"Name it, or leave it out (leave_out).\n{cad.table((3,), ROWS)}"
        )
    kept = {name: [n for n in own if n not in out] for name, own in picked.items()}
    return {name: own for name, own in kept.items() if own}


def named_surfaces(cad: Cad, wanted: Mapping[str, Which], out: set[int]) -> dict[str, list[int]]:
    """Numbers of the surfaces of each name that bound a volume which is not left out.

    Args:
        cad: The content of the file.
        wanted: The choice of each name.
        out: Numbers of volumes that are left out.

    Raises:
        SceneError: If a name picks nothing, or only entities that bound none of these volumes.
    """
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
    return groups | {name: numbers_of(cad, dim, f"'{name}'", w) for name, w in wanted.items()}


def numbers_of(cad: Cad, dim: int, name: str, which: Which) -> list[int]:
    """Numbers of the entities that a name stands for.

    Args:
        cad: The content of the file.
        dim: 3 for volumes, 2 for surfaces.
        name: The name, for messages.
        which: Its choice.

    Raises:
        SceneError: If that is nothing, or no way to pick, or a condition fails.
    """
    each = [which] if isinstance(which, str) or not isinstance(which, Iterable) else list(which)
    found: set[int] = set()
    for one in each:
        if isinstance(one, str):
            matches = [e.number for e in cad.of(dim) if e.label == one]
        elif callable(one):
            matches = [e.number for e in cad.of(dim) if _fulfils(one, e, dim, name)]
        elif isinstance(one, (int, np.integer)) and not isinstance(one, bool):
            matches = [e.number for e in cad.of(dim) if e.number == one]
        else:
            raise SceneError(
                f"read_cad: {name} must be a number, a label, a function of a CadEntity or a list "
                f"of these, got {shown(one)}."
            )
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


def _fulfils(
    condition: Callable[[CadEntity], bool], entity: CadEntity, dim: int, name: str
) -> bool:
    """Whether an entity is one that a condition picks.

    Raises:
        SceneError: If the condition fails.
    """
    try:
        return bool(condition(entity))
    except Exception as error:  # whatever a user's function may raise
        raise SceneError(
            f"read_cad: the condition of {name} failed with {type(error).__name__}: {error}, at "
            f"{CALLED[dim][:-1]} {entity.number} of kind '{entity.kind}'."
        ) from error
