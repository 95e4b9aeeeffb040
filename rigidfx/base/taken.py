"""Values of a user as they were when they were given, and arrays that nobody is to change.

A record that is checked once must not change afterwards: what it was made from is copied when it is
taken, and what it holds can be read only. A function of time is called later by its nature; what it
gives is copied by `inputs.numbers`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import fields
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

__all__ = ["read_only", "seal", "take_fields", "taken"]

Entry = TypeVar("Entry", bound=np.generic)

PLAIN = (bool, int, float, complex, str, bytes, np.generic)  # what cannot change


def taken(value: Any) -> Any:
    """A value that follows no later change of what was given.

    Arrays become read-only copies, of no dimension a number; lists become tuples, dicts read-only
    ones, sets frozen ones, and so does what is in them. Functions, records and whatever else there
    is stay what they are.

    Args:
        value: What was given.
    """
    try:
        return _taken(value)
    except RecursionError:
        return value  # it holds itself, which no check lets pass


def _taken(value: Any) -> Any:
    if value is None or isinstance(value, PLAIN) or callable(value):
        return value
    if hasattr(type(value), "__array__"):  # an array, or a column of a table
        return _array(value)
    if isinstance(value, Mapping):
        return MappingProxyType({name: _taken(item) for name, item in value.items()})
    if isinstance(value, Set):
        return frozenset(value)
    if isinstance(value, Sequence):
        return tuple(map(_taken, value))
    return value


def _array(value: Any) -> Any:
    try:
        array = np.array(value)
    except (TypeError, ValueError, RuntimeError):
        return value  # a check says what was expected
    return read_only(array) if array.ndim else array[()]


def take_fields(record: Any) -> None:
    """Have a frozen dataclass keep its fields as they are now.

    Args:
        record: The record, while it is made.
    """
    for field in fields(record):
        object.__setattr__(record, field.name, taken(getattr(record, field.name)))


def seal(record: Any) -> None:
    """Have an object show its arrays read-only, without a copy.

    Args:
        record: The object, while it is made of arrays that nobody changes any more.
    """
    for name, value in list(vars(record).items()):
        if isinstance(value, np.ndarray):
            object.__setattr__(record, name, read_only(value))


def read_only(array: npt.NDArray[Entry]) -> npt.NDArray[Entry]:
    """The same numbers, not a copy, through an array that cannot be written to.

    Args:
        array: Any array; it can still be written to.
    """
    view = array.view()
    view.flags.writeable = False
    return view
