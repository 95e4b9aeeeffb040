"""Values of a user as they were when they were given, and arrays that nobody is to change.

A record that is checked once must not change afterwards: what it was made from is copied when it is
taken, and what it holds can be read only. A function of time is called later by its nature;
`inputs.numbers` copies its results.

What is a number or an array of them to someone else, such as a constant of DOLFINx, an array of C
or a tensor of another package, could be changed later too: it becomes a float, an array or a tuple.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import fields
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.inputs import is_function, numbers

Checks = dict[str, Callable[[str, str, Any], object]]  # by names of fields
Entry = TypeVar("Entry", bound=np.generic)

PLAIN = (bool, int, float, complex, str, bytes)  # what cannot change
ARRAY = ("__array__", "__array_interface__", "__array_struct__")  # what NumPy makes an array of


def taken(value: Any) -> Any:
    """A value that follows no later change of the given one.

    Arrays become read-only copies, of no dimension a number; other kinds of numbers floats; lists
    become tuples, dicts read-only ones, sets frozen ones, and their contents likewise. Functions,
    records and other values stay as they are.
    """
    try:
        return _taken(value)
    except RecursionError:
        return value  # it holds itself, which no check lets pass


def _taken(value: Any) -> Any:
    if value is None or isinstance(value, PLAIN) or is_function(value):
        return value
    if any(hasattr(value, name) for name in ARRAY) or _is_buffer(value):
        return _array(value)
    if hasattr(value, "__float__"):
        return _float(value)
    if isinstance(value, Mapping):
        return MappingProxyType({name: _taken(item) for name, item in value.items()})
    if isinstance(value, Set):
        return frozenset(value)
    if isinstance(value, Sequence):
        return tuple(map(_taken, value))
    if not callable(value) and hasattr(value, "__len__") and hasattr(value, "__getitem__"):
        return _items(value)
    return value


def _is_buffer(value: Any) -> bool:
    """Whether a value lends its memory, as arrays of C do."""
    try:
        memoryview(value).release()
    except (TypeError, ValueError, BufferError):
        return False
    return True


def _array(value: Any) -> Any:
    try:
        # A copy of what is asked for: a foreign kind may not care whether one is asked for.
        array = (np.asanyarray if np.ma.is_masked(value) else np.asarray)(value).copy()
    except Exception:  # whatever a foreign kind of array may raise
        return value  # a check says what was expected
    if array.dtype == object:  # whose items may change
        real = numbers(array)
        array = real if real.shape == array.shape else array
    if array.ndim:
        return read_only(array)
    return array.item() if array.dtype.kind in "iuf" and array.dtype.itemsize <= 8 else array[()]


def _float(value: Any) -> Any:
    """A foreign kind of number, such as a fraction, as a float."""
    try:
        return float(value)
    except Exception:  # such as an expression that has no value
        return value  # a check says what was expected


def _items(value: Any) -> Any:
    """A value that is numbered like a list, as a tuple."""
    try:
        return tuple(_taken(value[k]) for k in range(len(value)))
    except Exception:  # numbered in another way
        return value


def take_fields(record: Any) -> None:
    """Freeze the fields of a dataclass as they are now.

    Args:
        record: The record, while it is made.
    """
    for field in fields(record):
        object.__setattr__(record, field.name, taken(getattr(record, field.name)))


def check_fields(record: Any, checks: Checks) -> None:
    """Check fields of a dataclass, with its kind as their owner.

    Args:
        record: The record, while it is made.
        checks: Functions such as `inputs.positive`. None passes where it is the default.
    """
    for field in fields(record):
        value = getattr(record, field.name)
        if field.name in checks and (value is not None or field.default is not None):
            checks[field.name](type(record).__name__, field.name, value)


def seal(record: Any) -> None:
    """Make the arrays of an object read-only, without a copy.

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
