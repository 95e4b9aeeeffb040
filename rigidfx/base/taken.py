"""Values of a user: as they were when they were given, and whether they are the same elsewhere.

Values of a checked record are copies, and can be read only. Numbers and arrays of others, such as a
constant of DOLFINx or a tensor of another package, become floats, arrays or tuples. A script runs
on every rank: where it draws random numbers, or reads a clock, ranks would take different decisions
and wait for each other for ever. `check_same` compares values before a run or a checkpoint.
"""

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import is_function, numbers
from rigidfx.base.sealed import read_only

Checks = dict[str, Callable[[str, str, Any], object]]  # by names of fields

PLAIN = (type(None), bool, int, float, complex, str, bytes)  # what cannot change
ARRAY = ("__array__", "__array_interface__", "__array_struct__")  # what NumPy makes an array of
SHOWN = 120  # characters of what a rank was given, a third of them before where it differs


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
    try:
        if isinstance(value, PLAIN) or is_function(value):
            return value
        if any(hasattr(value, name) for name in ARRAY) or _is_buffer(value):
            return _array(value)
        if hasattr(value, "__float__"):
            return float(value)
        if isinstance(value, Mapping):
            return MappingProxyType({name: _taken(item) for name, item in value.items()})
        if isinstance(value, Set):
            return frozenset(value)
        if isinstance(value, Sequence):
            return tuple(map(_taken, value))
        if not callable(value) and hasattr(value, "__len__") and hasattr(value, "__getitem__"):
            return tuple(_taken(value[k]) for k in range(len(value)))
    except Exception as error:  # whatever a foreign kind of array or number may raise
        if isinstance(error, RecursionError):
            raise
    return value  # a check says what was expected


def _is_buffer(value: Any) -> bool:
    """Whether a value lends its memory, as arrays of C do."""
    try:
        memoryview(value).release()
    except (TypeError, ValueError, BufferError):
        return False
    return True


def _array(value: Any) -> Any:
    # A copy of what is asked for: a foreign kind may not care whether one is asked for.
    array = (np.asanyarray if np.ma.is_masked(value) else np.asarray)(value).copy()
    if array.dtype == object:  # whose items may change
        real = numbers(array)
        array = real if real.shape == array.shape else array
    if array.ndim:
        return read_only(array)
    return array.item() if array.dtype.kind in "iuf" and array.dtype.itemsize <= 8 else array[()]


def take_fields(record: Any) -> None:
    """Freeze the fields of a dataclass, which is being made, as they are now."""
    for field in fields(record):
        object.__setattr__(record, field.name, taken(getattr(record, field.name)))


def check_fields(record: Any, checks: Checks) -> None:
    """Check fields of a dataclass, which is being made; None passes where it is the default."""
    for field in fields(record):
        value = getattr(record, field.name)
        if field.name in checks and (value is not None or field.default is not None):
            checks[field.name](type(record).__name__, field.name, value)


def check_same(comm: MPI.Intracomm, owner: str, given: Mapping[str, Any]) -> None:
    """Check that all ranks were given the same numbers and names. Collective.

    Sequences are compared item by item. A difference raises a `SceneError` on every rank that says
    to whom it was given, its name, and the values of two ranks.
    """
    if comm.size == 1:
        return
    every = dict(items(given))
    digests = comm.allgather({name: digest(value) for name, value in every.items()})
    for rank, other in enumerate(digests):
        if (name := difference(digests[0], other)) is not None:
            texts = comm.allgather(_content(every[name]) if name in every else "nothing")
            first, second = _excerpts(texts[0], texts[rank])
            raise SceneError(
                f"{owner}: {name} is not the same on all ranks: {first} on rank 0, {second} on "
                f"rank {rank}. What is random, or read from a file, has to be found on one rank "
                "and broadcast."
            )


def items(given: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Names and values; of a sequence, item by item."""
    for name, value in given.items():
        if isinstance(value, (list, tuple)):
            yield from ((f"{name}[{k}]", item) for k, item in enumerate(value))
        else:
            yield name, value


def digest(value: Any) -> str:
    """A hash of the comparable content of a value: numbers, names, breakpoints of functions."""
    return hashlib.sha256(_content(value).encode(errors="backslashreplace")).hexdigest()


def difference(first: Mapping[str, Any], second: Mapping[str, Any]) -> str | None:
    """The first name whose values differ, or which one of both does not have."""
    names = {**first, **second}
    return next((name for name in names if first.get(name) != second.get(name)), None)


def _excerpts(first: str, second: str) -> list[str]:
    """The parts of two texts around the place from which on they differ."""
    pairs = enumerate(zip(first, second, strict=False))
    alike = next((k for k, (a, b) in pairs if a != b), min(len(first), len(second)))
    start = max(0, alike - SHOWN // 3) if max(len(first), len(second)) > SHOWN else 0
    before, end = "… " * (start > 0), start + SHOWN
    return [before + text[start:end] + " …" * (len(text) > end) for text in (first, second)]


def _content(value: Any) -> str:
    """All that can be compared of a value, as text that does not depend on its rank."""
    if isinstance(value, (np.ndarray, np.generic)):
        array = np.asarray(value)
        if array.dtype.kind in "fc":
            array = array.astype(np.float64 if array.dtype.kind == "f" else np.complex128)
        if array.ndim:
            return f"array({_content(array.tolist())}, {array.shape}, {value.dtype})"
        value = array.item()
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return _number(value)
    if isinstance(value, PLAIN):
        return repr(value)
    name = (value if isinstance(value, type) else type(value)).__qualname__
    if isinstance(value, os.PathLike):
        return repr(os.fspath(value))
    if is_dataclass(value) and not isinstance(value, type):
        own = (f"{f.name}={_content(getattr(value, f.name, None))}" for f in fields(value))
        return f"{name}({', '.join(own)})"
    if isinstance(value, Mapping):
        pairs = (f"{_content(key)}: {_content(item)}" for key, item in value.items())
        return f"{{{', '.join(pairs)}}}"
    if isinstance(value, Sequence):
        return f"({', '.join(map(_content, value))})"
    if isinstance(value, Set):
        return f"{name}({', '.join(sorted(map(_content, value)))})"
    breakpoints = () if isinstance(value, type) else getattr(value, "breakpoints", ())
    return f"{name} with breakpoints {_content(tuple(breakpoints))}" if len(breakpoints) else name


def _number(value: float) -> str:
    """One form of a number, whatever its kind: 1 is 1.0."""
    try:
        whole = isinstance(value, int) and float(value) != value
    except OverflowError:
        whole = True
    return hex(int(value)) if whole else repr(float(value))  # Python writes at most 4300 digits
