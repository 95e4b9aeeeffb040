"""All that a run is made of, compared attribute by attribute with another run."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Set

import numpy as np
from dolfinx import fem

# Names of attributes, of all classes or of one.
APART = {
    *(
        "_began",
        "_flexible",
        "_rigid",
        "_switching",
        "wall",
        "Whereabouts._told",
        "_compiled",
    ),  # wall times
    *("changes", "_changes", "_asked", "_rotations", "_places", "_writes"),  # writes into a state
    *("scene", "_scene", "_element", "_here", "_columns"),  # as they were given, or by identity
    *("_field", "_cell_field", "_square"),  # refilled before they are read
    *("WholeMass._matrix", "WholeMass._without"),  # made when it is asked for
    *("_last", "Whereabouts._first", "held", "_seen"),  # reports, the preload, bodies by identity
    *("Growth._strains", "Growth._reached"),  # of a last look
    *("Growth._found", "Growth._linear"),  # made when they are asked for
}


def differences(one, other, at="run") -> list[str]:
    """Paths of attributes that differ; empty if none does."""
    return list(_differing(one, other, at, set()))


def _differing(a, b, at, seen) -> Iterator[str]:
    if (id(a), id(b)) in seen:
        return
    seen.add((id(a), id(b)))
    if type(a) is not type(b) and not (isinstance(a, Mapping) and isinstance(b, Mapping)):
        yield f"{at}: {type(a).__name__}, {type(b).__name__}"
    elif isinstance(a, np.ndarray) and a.dtype != object:
        if a.shape != b.shape or not np.array_equal(a, b, equal_nan=a.dtype.kind in "fc"):
            yield at
    elif isinstance(a, fem.Function):
        yield from _differing(a.x.array, b.x.array, at, seen)
    elif isinstance(a, (bool, int, float, complex, str, bytes, type(None), np.generic)):
        if a != b and not (a != a and b != b):
            yield f"{at}: {a}, {b}"
    elif isinstance(a, (list, tuple, deque)):
        yield from _of_sequence(a, b, at, seen)
    elif isinstance(a, Set):
        if sorted(map(str, a)) != sorted(map(str, b)):
            yield at
    elif isinstance(a, Mapping):
        yield from _of_sequence(list(a.values()), list(b.values()), at, seen)
    elif type(a).__module__.startswith("rigidfx."):
        for name, value in _attributes(a):
            if not APART & {name, f"{type(a).__name__}.{name}"}:
                yield from _differing(value, getattr(b, name, None), f"{at}.{name}", seen)


def _of_sequence(a, b, at, seen) -> Iterator[str]:
    if len(a) != len(b):
        yield f"{at}: {len(a)} items, {len(b)}"
        return
    for k, (x, y) in enumerate(zip(a, b, strict=True)):
        yield from _differing(x, y, f"{at}[{k}]", seen)


def _attributes(a) -> Iterator[tuple[str, object]]:
    yield from getattr(a, "__dict__", {}).items()
