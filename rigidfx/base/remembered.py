"""The state that objects keep from step to step.

Each class says so itself, beside its fields:

    remembered: ClassVar[Remembered] = same("steps") | {"worst": ON_CELLS, "_swings": PART}

A checkpoint asks the parts of a run, and they ask theirs. Other members are made anew
from the scene and from named values: forms, factors, first guesses. A kind says how the ranks'
values of a field become one value in the order of the mesh, and how each rank gets its own back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigidfx.base.errors import SceneError
from rigidfx.base.kinds import (
    CELLS,
    FIELD,
    LARGEST,
    OBJECTS,
    ON_CELLS,
    ON_DOFS,
    ON_NODES,
    SAME,
    Each,
    Items,
    Kind,
    Maybe,
    Record,
)
from rigidfx.base.mesh_order import MeshOrder

__all__ = [
    "CELLS",
    "FIELD",
    "LARGEST",
    "OBJECTS",
    "ON_CELLS",
    "ON_DOFS",
    "ON_NODES",
    "PART",
    "SAME",
    "ByObject",
    "Each",
    "Forgetful",
    "Items",
    "Kind",
    "Maybe",
    "Part",
    "Record",
    "Remembered",
    "joined",
    "part_of",
    "restore",
    "same",
]


class ByObject(Kind):
    """Values that are the same on all ranks, by the identity of effects or obstacles."""

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        """Rank 0's mapping, by numbers of the objects."""
        numbers = orders[0].numbers()
        return {numbers[key]: one for key, one in value.items()}

    def own(self, whole: Any, order: MeshOrder) -> Any:
        """The mapping by the identities of this rank's objects."""
        return {id(order.named[k]): one for k, one in whole.items()}

    def set(self, owner: Any, name: str, whole: Any, order: MeshOrder) -> None:
        """Fill the mapping, which others may hold."""
        mapping = getattr(owner, name)  # others may hold it
        mapping.clear()
        mapping.update(self.own(whole, order))


class Part(Kind):
    """An object, or a sequence of objects, with `remembered` of their own."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        """What the object, or each of them, remembers."""
        if isinstance(value, (list, tuple)):
            return [part_of(one, order) for one in value]
        return part_of(value, order)

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        """The memory of the object, or of each, joined over the ranks."""
        if isinstance(value, (list, tuple)):
            both = zip(value, zip(*parts, strict=True), strict=True)
            return [joined(one, each, orders) for one, each in both]
        return joined(value, parts, orders)

    def set(self, owner: Any, name: str, whole: Any, order: MeshOrder) -> None:
        """Restore the object, or each of them."""
        value = getattr(owner, name)
        if isinstance(value, (list, tuple)):
            for one, own in zip(value, whole, strict=True):
                restore(one, own, order)
        else:
            restore(value, whole, order)


PART = Part()
Remembered = dict[str, Kind]


def same(*names: str) -> Remembered:
    """Fields whose values are the same on all ranks.

    Args:
        names: Of the fields.
    """
    return dict.fromkeys(names, SAME)


class Forgetful(Exception):
    """A class does not name its state; its argument is the name."""


def _kinds(owner: Any) -> Remembered:
    # Of the class itself: what a subclass adds nobody else knows.
    kinds: Remembered | None = vars(type(owner)).get("remembered")
    if kinds is None:
        raise Forgetful(type(owner).__name__)
    return kinds


def part_of(owner: Any, order: MeshOrder) -> dict[str, Any] | None:
    """A rank's part of the state of an object; None of no object.

    Args:
        owner: The object, whose class has `remembered`.
        order: Of this rank.

    Raises:
        Forgetful: If its class, or that of an object in it, has not.
    """
    if owner is None:
        return None
    kinds = _kinds(owner)
    return {name: kind.part(getattr(owner, name), order) for name, kind in kinds.items()}


def joined(owner: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> dict[str, Any] | None:
    """All that an object remembers, in the order of the mesh; on rank 0.

    Args:
        owner: Rank 0's object.
        parts: Of each rank.
        orders: Of each rank.
    """
    if owner is None:
        return None
    kinds = _kinds(owner)
    return {
        name: kind.whole(getattr(owner, name), [part[name] for part in parts], orders)
        for name, kind in kinds.items()
    }


def restore(owner: Any, whole: Mapping[str, Any] | None, order: MeshOrder) -> None:
    """Give an object the state of another one of its class. Collective.

    Args:
        owner: The object.
        whole: Of `joined`, on all ranks.
        order: Of this rank.

    Raises:
        SceneError: On every rank, if it remembers other things.
    """
    if owner is None or whole is None:
        return
    kinds = _kinds(owner)
    if kinds.keys() != whole.keys():
        raise SceneError(
            f"resume: {type(owner).__name__} remembers other things than in the checkpoint, which "
            "another version of rigidfx has written. Resume with that version, or run anew."
        )
    for name, kind in kinds.items():
        kind.set(owner, name, whole[name], order)
