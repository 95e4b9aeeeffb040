"""Kinds of remembered values: how those of ranks become one in the order of the mesh, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from rigidfx.base.mesh_order import MeshOrder

__all__ = [
    "CELLS",
    "FIELD",
    "LARGEST",
    "OBJECTS",
    "ON_CELLS",
    "ON_DOFS",
    "ON_NODES",
    "SAME",
    "Each",
    "Items",
    "Kind",
    "Maybe",
    "Record",
]


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


class Items(Kind):
    """A tuple of values of different kinds."""

    def __init__(self, *kinds: Kind) -> None:
        """Say of which kinds."""
        self._kinds = kinds

    def part(self, value: Any, order: MeshOrder) -> Any:
        """The gathered form of each value by its kind."""
        return [kind.part(one, order) for kind, one in zip(self._kinds, value, strict=True)]

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        """One value of the parts of each, by its kind."""
        three = zip(self._kinds, value, zip(*parts, strict=True), strict=True)
        return [kind.whole(one, each, orders) for kind, one, each in three]

    def own(self, whole: Any, order: MeshOrder) -> Any:
        """A rank's values by their kinds, as a tuple."""
        return tuple(kind.own(one, order) for kind, one in zip(self._kinds, whole, strict=True))


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
