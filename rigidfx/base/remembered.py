"""The state that objects keep from step to step.

Each class names it beside its fields:

    remembered: ClassVar[Remembered] = same("steps") | {"worst": ON_CELLS, "_swings": PART}

A checkpoint asks the parts of a run, and they ask theirs. Other members are made anew from the
scene and from named values: forms, factors, first guesses. Values on cells and nodes are `Rows` by
their numbers in the mesh, which do not depend on ranks. Other values are those of rank 0.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array, Ints


@dataclass(frozen=True)
class MeshOrder:
    """The number in the mesh of each cell and node of a rank."""

    first: bool  # whether this is rank 0
    cells: Ints  # numbers of the owned cells
    nodes: Ints  # numbers of the local nodes, owned ones first
    owned: int  # number of owned nodes
    # Effects and obstacles, which objects know by their identity; alike on all ranks
    named: tuple[Any, ...] = ()

    @property
    def own_nodes(self) -> Ints:
        """Numbers of the owned nodes."""
        return self.nodes[: self.owned]

    def numbers(self) -> dict[int, int]:
        """Place in `named` of each object, by its identity."""
        return {id(one): k for k, one in enumerate(self.named)}


class Rows(NamedTuple):
    """Arrays with a row for each cell or node of some, by its number: sorted, each once."""

    numbers: Ints
    columns: tuple[Array, ...]

    def at(self, numbers: Ints) -> list[Array]:
        """The rows of some of the numbers, of each array."""
        where = np.searchsorted(self.numbers, numbers)
        return [column[where] for column in self.columns]

    def among(self, numbers: Ints) -> Ints:
        """Places in a list of numbers of those that are here."""
        return np.flatnonzero(np.isin(numbers, self.numbers)).astype(np.int32)


def rows(numbers: Ints, *columns: Array) -> Rows:
    """Arrays over numbers in any order."""
    every, first = np.unique(numbers, return_index=True)
    return Rows(every, tuple(column[first] for column in columns))


def joined(parts: Sequence[Any]) -> Any:
    """One value of the parts of all ranks; a value that is rank 0's is None on the others."""
    first, *others = parts
    if not others or others[0] is None:
        return first
    if isinstance(first, Rows):
        columns = zip(*(part.columns for part in parts), strict=True)
        return rows(np.concatenate([part.numbers for part in parts]), *map(np.concatenate, columns))
    if isinstance(first, dict):
        return {name: joined([part[name] for part in parts]) for name in first}
    return [joined(each) for each in zip(*parts, strict=True)]


class Kind:
    """A value that is the same on all ranks."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        """The gathered form of a rank's value: `Rows`, or lists and dicts of them, or rank 0's."""
        return value if order.first else None

    def own(self, whole: Any, order: MeshOrder) -> Any:
        """A rank's value of the joined parts."""
        return whole

    def set(self, owner: Any, name: str, whole: Any, order: MeshOrder) -> None:
        """Give a rank's object its value back."""
        setattr(owner, name, None if whole is None else self.own(whole, order))


class _Anew(Kind):
    """A value that is made when it is asked for, None before."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        return None


class _OnMesh(Kind):
    """An array over owned cells or nodes, or None."""

    def __init__(self, numbers: Callable[[MeshOrder], Ints], dofs: bool = False) -> None:
        """Name the numbers, and whether the three values of all nodes lie in one row."""
        self._numbers, self._dofs = numbers, dofs

    def part(self, value: Any, order: MeshOrder) -> Any:
        if value is None:
            return None
        numbers = self._numbers(order)
        return rows(numbers, (value.reshape(-1, 3) if self._dofs else value)[: numbers.size])

    def own(self, whole: Any, order: MeshOrder) -> Any:
        (found,) = whole.at(self._numbers(order))
        return found.reshape(-1) if self._dofs else found


class _Field(_OnMesh):
    """A function with three numbers at each node, which stays the same object."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        return super().part(value.x.array, order)

    def set(self, owner: Any, name: str, whole: Any, order: MeshOrder) -> None:
        getattr(owner, name).x.array[:] = whole.at(order.nodes)[0].reshape(-1)


class _Objects(Kind):
    """A tuple of effects."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        numbers = order.numbers()
        return super().part([numbers[id(one)] for one in value], order)

    def own(self, whole: Any, order: MeshOrder) -> Any:
        return tuple(order.named[k] for k in whole)


class ByObject(Kind):
    """Values that are the same on all ranks, by the identity of effects or obstacles."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        """Rank 0's mapping, by numbers of the objects."""
        numbers = order.numbers()
        return super().part({numbers[key]: one for key, one in value.items()}, order)

    def set(self, owner: Any, name: str, whole: Any, order: MeshOrder) -> None:
        """Fill the mapping, which others may hold, by the identities of this rank's objects."""
        mapping = getattr(owner, name)
        mapping.clear()
        mapping.update({id(order.named[k]): one for k, one in whole.items()})


class Record(Kind):
    """A frozen dataclass with owned `nodes` and arrays over them, or None."""

    def __init__(self, made: type, *over: str, cells: str = "", **inner: Kind) -> None:
        """Name a class, its fields over the nodes, that of owned cells, and kinds of other fields.

        Fields that are not named are the same on all ranks.
        """
        names = {f.name for f in fields(made)} - {"nodes", *over, cells}
        self._made, self._over, self._cells = made, over, cells
        self._kinds = {name: inner.get(name, SAME) for name in names}

    def part(self, value: Any, order: MeshOrder) -> Any:
        """Values over the nodes, the cells, and other fields as their kinds gather them."""
        if value is None:
            return None
        over = (getattr(value, name) for name in self._over)
        cells = getattr(value, self._cells) if self._cells else []
        out = {name: kind.part(getattr(value, name), order) for name, kind in self._kinds.items()}
        return out | {"nodes": rows(order.nodes[value.nodes], *over), "": rows(order.cells[cells])}

    def own(self, whole: Any, order: MeshOrder) -> Any:
        """The record of the nodes and cells that this rank owns."""
        if whole is None:
            return None
        given = {name: kind.own(whole[name], order) for name, kind in self._kinds.items()}
        given["nodes"] = whole["nodes"].among(order.own_nodes)
        over = whole["nodes"].at(order.own_nodes[given["nodes"]])
        given |= zip(self._over, over, strict=True)
        if self._cells:
            given[self._cells] = whole[""].among(order.cells)
        return self._made(**given)


class Each(Kind):
    """Dataclass records by numbers that all ranks know."""

    def __init__(self, made: type, **inner: Kind) -> None:
        """Name a class, and kinds of its fields; others are the same on all ranks."""
        self._made = made
        self._kinds = {f.name: inner.get(f.name, SAME) for f in fields(made)}

    def part(self, value: Any, order: MeshOrder) -> Any:
        """The fields of each record, as their kinds gather them."""
        return {
            number: {
                name: kind.part(getattr(one, name), order) for name, kind in self._kinds.items()
            }
            for number, one in value.items()
        }

    def own(self, whole: Any, order: MeshOrder) -> Any:
        """The records of this rank."""
        return {
            number: self._made(**{n: kind.own(one[n], order) for n, kind in self._kinds.items()})
            for number, one in whole.items()
        }


class Part(Kind):
    """An object, or a sequence of objects, with `remembered` of their own."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        """The parts of the object, or of each of them."""
        return part_of(value, order)

    def set(self, owner: Any, name: str, whole: Any, order: MeshOrder) -> None:
        """Restore the object, or each of them."""
        restore(getattr(owner, name), whole, order)


Remembered = dict[str, Kind]
SAME, ANEW, PART, OBJECTS = Kind(), _Anew(), Part(), _Objects()
ON_CELLS = _OnMesh(lambda order: order.cells)
ON_NODES = _OnMesh(lambda order: order.own_nodes)
ON_DOFS, FIELD = (kind(lambda order: order.own_nodes, dofs=True) for kind in (_OnMesh, _Field))


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


def part_of(owner: Any, order: MeshOrder) -> Any:
    """A rank's part of the state of an object, or of each of a sequence; None of no object.

    A class without `remembered` raises `Forgetful`.
    """
    if isinstance(owner, (list, tuple)):
        return [part_of(one, order) for one in owner]
    if owner is None:
        return None
    kinds = _kinds(owner)
    return {name: kind.part(getattr(owner, name), order) for name, kind in kinds.items()}


def restore(owner: Any, whole: Any, order: MeshOrder) -> None:
    """Give an object, or each of a sequence, the state that joined parts of its class have.

    It raises a `SceneError` on every rank, if it remembers other things.
    """
    if isinstance(owner, (list, tuple)):
        for one, own in zip(owner, whole, strict=True):
            restore(one, own, order)
        return
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
