"""Whether all ranks were given the same: one comparison, before anything depends on it.

A script runs on every rank. Where it draws random numbers, or reads a clock or a rank's own file,
ranks would take different decisions and then wait for each other for ever.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown

SHOWN = 120  # characters of what a rank was given, a third of them before where it differs


def check_same(comm: MPI.Intracomm, owner: str, given: Mapping[str, Any]) -> None:
    """Check that all ranks were given the same numbers and names. Collective.

    Functions cannot be compared; of them only that there are such, and their breakpoints.

    Args:
        comm: Communicator of the mesh.
        owner: To whom it was given, for the message.
        given: The given value, by its name. A sequence is compared item by item.

    Raises:
        SceneError: On every rank, if something differs; the message names it, and a rank's value.
    """
    if comm.size == 1:
        return
    every = dict(items(given))
    digests = comm.allgather({name: digest(value) for name, value in every.items()})
    for rank, other in enumerate(digests):
        names = [*digests[0], *(name for name in other if name not in digests[0])]
        for name in names:
            if digests[0].get(name) != other.get(name):
                texts = comm.allgather(_text(every[name]) if name in every else "nothing")
                first, second = excerpts(texts[0], texts[rank])
                raise SceneError(
                    f"{owner}: {name} is not the same on all ranks: {first} on rank 0, "
                    f"{second} on rank {rank}. What is random, or read from a file, has to "
                    "be found on one rank and broadcast."
                )


def _text(value: Any) -> str:
    """A value in full, without where something lies in a rank's memory."""
    # Each number by itself: NumPy would write all of an array with as many digits as one needs.
    with np.printoptions(threshold=sys.maxsize, formatter={"float_kind": lambda x: repr(float(x))}):
        return re.sub(r" at 0x[0-9a-f]+", "", shown(value))


def excerpts(first: str, second: str) -> tuple[str, str]:
    """The parts of two texts around the place from which on they differ."""
    if first == second:
        return first[:SHOWN], "what looks the same but has other breakpoints, or another kind,"
    pairs = zip(first, second, strict=False)
    alike = next((k for k, (a, b) in enumerate(pairs) if a != b), min(len(first), len(second)))
    start = max(0, alike - SHOWN // 3)
    if max(len(first), len(second)) <= SHOWN:
        start = 0
    parts = (text[start : start + SHOWN] for text in (first, second))
    before, ends = "… " if start else "", [start + SHOWN < len(t) for t in (first, second)]
    one, other = (before + part + " …" * end for part, end in zip(parts, ends, strict=True))
    return one, other


def items(given: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Names and values; of a sequence, item by item.

    Args:
        given: Values by name.
    """
    for name, value in given.items():
        if isinstance(value, (list, tuple)):
            yield from ((f"{name}[{k}]", item) for k, item in enumerate(value))
        else:
            yield name, value


def digest(value: Any) -> bytes:
    """A hash of the comparable content of a value: numbers, names, times of kinks of functions."""
    return hashlib.sha256(repr(_plain(value)).encode()).digest()


def _plain(value: Any) -> Any:
    """The comparable content of a value."""
    if value is None or isinstance(value, (bool, complex, str, bytes)):
        return value
    if isinstance(value, (float, int)):
        return _number(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, (np.ndarray, np.generic)):
        array = np.asarray(value)
        if not array.ndim and array.dtype.kind in "iuf":
            return _number(array.item())
        kind = str(array.dtype)
        if array.dtype.kind in "fc":  # a wide float has bytes that mean nothing
            array = array.astype(np.float64 if array.dtype.kind == "f" else np.complex128)
        content = array.tolist() if array.dtype == object else array.tobytes()
        return array.shape, kind, content
    if isinstance(value, type):  # a record's class has no breakpoints, but the property
        return value.__qualname__
    name = type(value).__qualname__
    if is_dataclass(value):
        own = [(f.name, _plain(getattr(value, f.name, None))) for f in fields(value)]
        return name, own, _breakpoints(value)
    if isinstance(value, Mapping):
        return "mapping", [(_plain(key), _plain(item)) for key, item in value.items()]
    if isinstance(value, Sequence):
        return "sequence", [_plain(item) for item in value]
    if isinstance(value, Set):
        return name, sorted(repr(_plain(item)) for item in value)
    return name, _breakpoints(value)


def _number(value: float) -> Any:
    """One form of a number, whatever its kind: 1 is 1.0."""
    try:
        whole = isinstance(value, int) and float(value) != value
    except OverflowError:
        whole = True
    return hex(int(value)) if whole else float(value)  # Python writes no more than 4300 digits


def _breakpoints(value: Any) -> list[float]:
    return [float(t) for t in getattr(value, "breakpoints", ())]
