"""The state that objects keep from step to step.

Each class says so itself, beside its fields:

    remembered: ClassVar[Remembered] = same("steps") | {"worst": ON_CELLS, "_swings": PART}

A checkpoint asks the parts of a run, and they ask theirs. Other members are made anew
from the scene and from named values: forms, factors, first guesses. A kind says how the ranks'
values of a field become one value in the order of the mesh, and how each rank gets its own back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.mesh_order import MeshOrder


class Kind:
    """A value that is the same on all ranks."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        """The gathered form of a rank's value."""
        return value if order.first else None

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        """One value of the parts of all ranks.

        Args:
            value: Rank 0's value.
            parts: The gathered values of all ranks.
            orders: Of each rank.
        """
        return parts[0]

    def own(self, whole: Any, order: MeshOrder) -> Any:
        """A rank's value of the whole."""
        return whole

    def set(self, owner: Any, name: str, whole: Any, order: MeshOrder) -> None:
        """Give a rank's object its value back."""
        setattr(owner, name, None if whole is None else self.own(whole, order))


class _Largest(Kind):
    """The largest value that each rank has seen: numbers, or arrays of them."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        return value

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        most = np.max(parts, axis=0)
        return most if isinstance(value, np.ndarray) else float(most)


class _OnCells(Kind):
    """An array over the owned cells, or None."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        return value

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        if value is None:
            return None
        out = np.empty((orders[0].every_cell, *value.shape[1:]), value.dtype)
        for part, order in zip(parts, orders, strict=True):
            out[order.cells] = part
        return out

    def own(self, whole: Any, order: MeshOrder) -> Any:
        return whole[order.cells]


class _OnNodes(Kind):
    """An array over the owned nodes, or None."""

    def __init__(self, *, dofs: bool = False) -> None:
        """Say how the array lies.

        Args:
            dofs: Whether the three numbers of all nodes lie in one row.
        """
        self._dofs = dofs

    def part(self, value: Any, order: MeshOrder) -> Any:
        if value is None:
            return None
        rows = value.reshape(-1, 3) if self._dofs else value
        return rows[: order.owned]

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        if value is None:
            return None
        out = np.empty((orders[0].every_node, *parts[0].shape[1:]), parts[0].dtype)
        for part, order in zip(parts, orders, strict=True):
            out[order.nodes[: order.owned]] = part
        return out

    def own(self, whole: Any, order: MeshOrder) -> Any:
        rows = whole[order.nodes[: order.owned]]
        return rows.reshape(-1) if self._dofs else rows


class _Cells(Kind):
    """Owned cells, sorted."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        return order.cells[value]

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        return np.sort(np.concatenate(parts))

    def own(self, whole: Any, order: MeshOrder) -> Any:
        return np.flatnonzero(np.isin(order.cells, whole)).astype(np.int32)


class Record(Kind):
    """A frozen dataclass with sets of cells and of nodes, and arrays over these nodes."""

    def __init__(
        self,
        made: type,
        nodes: str,
        over: Sequence[str],
        cells: Sequence[str] = (),
        inner: Mapping[str, Kind] | None = None,
        *,
        ghosts: bool = False,
    ) -> None:
        """Describe the fields; those that are not named are the same on all ranks.

        Args:
            made: The class.
            nodes: Field of the nodes, sorted.
            over: Fields over these nodes.
            cells: Fields of owned cells.
            inner: Fields that are records.
            ghosts: Whether nodes of other ranks are among the nodes.
        """
        self._made, self._nodes, self._over, self._ghosts = made, nodes, (*over,), ghosts
        self._inner = {**dict.fromkeys(cells, CELLS), **(inner or {})}
        self._names = [f.name for f in fields(made)]

    def _kind(self, name: str) -> Kind:
        return self._inner.get(name, SAME)

    def part(self, value: Any, order: MeshOrder) -> Any:
        """Numbers of its nodes, values over them, and other fields as their kinds gather them."""
        numbers = order.nodes[getattr(value, self._nodes)]
        others = [n for n in self._names if n != self._nodes and n not in self._over]
        out = {name: self._kind(name).part(getattr(value, name), order) for name in others}
        return out | {self._nodes: numbers} | {n: getattr(value, n) for n in self._over}

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        """Its fields over the nodes of all ranks, each of them once."""
        out = {}
        numbers, first = np.unique(
            np.concatenate([part[self._nodes] for part in parts]), return_index=True
        )
        for name in self._names:
            each = [part[name] for part in parts]
            if name == self._nodes:
                out[name] = numbers
            elif name in self._over:
                out[name] = np.concatenate(each)[first]
            else:
                out[name] = self._kind(name).whole(getattr(value, name), each, orders)
        return out

    def own(self, whole: Any, order: MeshOrder) -> Any:
        """The record of the nodes that this rank knows."""
        local = order.nodes if self._ghosts else order.nodes[: order.owned]
        place = np.full(order.every_node, -1)
        place[whole[self._nodes]] = np.arange(whole[self._nodes].size)
        here = np.flatnonzero(place[local] >= 0)
        given = {}
        for name in self._names:
            if name == self._nodes:
                given[name] = here.astype(np.int32)
            elif name in self._over:
                given[name] = whole[name][place[local[here]]]
            else:
                given[name] = self._kind(name).own(whole[name], order)
        return self._made(**given)


class Each(Kind):
    """A sequence of values of one kind, as many on all ranks; a tuple."""

    def __init__(self, kind: Kind) -> None:
        """Say of which kind."""
        self._kind = kind

    def part(self, value: Any, order: MeshOrder) -> Any:
        """The gathered form of each value."""
        return [self._kind.part(one, order) for one in value]

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        """One value of the parts of each."""
        both = zip(value, zip(*parts, strict=True), strict=True)
        return [self._kind.whole(one, each, orders) for one, each in both]

    def own(self, whole: Any, order: MeshOrder) -> Any:
        """A rank's values, as a tuple."""
        return tuple(self._kind.own(one, order) for one in whole)


class Maybe(Kind):
    """A value of a kind, or None, alike on all ranks."""

    def __init__(self, kind: Kind) -> None:
        """Keep the kind of the value."""
        self._kind = kind

    def part(self, value: Any, order: MeshOrder) -> Any:
        """The gathered form of the value, if there is one."""
        return None if value is None else self._kind.part(value, order)

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        """One value of the parts, if there is one."""
        return None if value is None else self._kind.whole(value, parts, orders)

    def own(self, whole: Any, order: MeshOrder) -> Any:
        """A rank's value, if there is one."""
        return None if whole is None else self._kind.own(whole, order)


class _Field(Kind):
    """A function with three numbers at each node, which stays the same object."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        return ON_DOFS.part(value.x.array, order)

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        return ON_DOFS.whole(value, parts, orders)

    def set(self, owner: Any, name: str, whole: Any, order: MeshOrder) -> None:
        getattr(owner, name).x.array[:] = whole[order.nodes].reshape(-1)


class _Objects(Kind):
    """A tuple of effects."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        numbers = order.numbers()
        return [numbers[id(one)] for one in value]

    def own(self, whole: Any, order: MeshOrder) -> Any:
        return tuple(order.named[k] for k in whole)


SAME, LARGEST, ON_CELLS, CELLS = Kind(), _Largest(), _OnCells(), _Cells()
ON_NODES, ON_DOFS, FIELD, OBJECTS = _OnNodes(), _OnNodes(dofs=True), _Field(), _Objects()


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
    """Fields whose values are the same on all ranks."""
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
