"""All that a run is made of, compared attribute by attribute with another run."""

from collections import deque
from collections.abc import Iterator, Mapping, Set

import numpy as np
from dolfinx import fem

# Names of attributes, of all classes or of one.
APART = {
    *("_began", "_flexible", "_rigid", "_switching", "wall", "_compiled"),  # wall times
    "Whereabouts._told",
    *("changes", "_changes", "_asked", "_rotations", "_places", "_writes"),  # writes into a state
    *("scene", "_scene", "_element", "_here", "_columns"),  # as they were given, or by identity
    *("_field", "_cell_field", "_square"),  # refilled before they are read
    "ShapedIncrements._work",  # room for C code
    *("WholeMass._matrix", "WholeMass._without"),  # made when it is asked for
    *("_last", "Whereabouts._first", "held", "_seen"),  # reports, the preload, bodies by identity
    "Growth._strains",  # of a last look
    *("FoundBodies._expanded", "FoundBodies._linear"),  # made when they are asked for
    *("Known.along", "Known.modes"),
}


def differences(one, other, within=0.0) -> list[str]:
    """Paths of attributes that differ; empty if none does.

    Numbers may differ by a part of them, those of an array by a part of its largest.
    """
    return list(_differing(one, other, "run", set(), within))


def _differing(a, b, at, seen, within) -> Iterator[str]:
    if (id(a), id(b)) in seen:
        return
    seen.add((id(a), id(b)))
    if type(a) is not type(b) and not (isinstance(a, Mapping) and isinstance(b, Mapping)):
        yield f"{at}: {type(a).__name__}, {type(b).__name__}"
    elif isinstance(a, np.ndarray) and a.dtype != object:
        if not (a.shape == b.shape and _same_numbers(a, b, within)):
            yield at
    elif isinstance(a, fem.Function):
        yield from _differing(a.x.array, b.x.array, at, seen, within)
    elif isinstance(a, (bool, int, float, complex, str, bytes, type(None), np.generic)):
        if a != b and not (isinstance(a, float) and _same_numbers(a, b, within)):
            yield f"{at}: {a}, {b}"
    elif isinstance(a, (list, tuple, deque)):
        yield from _of_sequence(a, b, at, seen, within)
    elif isinstance(a, Set):
        if sorted(map(str, a)) != sorted(map(str, b)):
            yield at
    elif isinstance(a, Mapping):
        yield from _of_sequence(list(a.values()), list(b.values()), at, seen, within)
    elif type(a).__module__.startswith("rigidfx."):
        for name, value in _attributes(a):
            if not APART & {name, f"{type(a).__name__}.{name}"}:
                yield from _differing(value, getattr(b, name, None), f"{at}.{name}", seen, within)


def _same_numbers(a, b, within):
    if np.asarray(a).dtype.kind not in "fc":
        return np.array_equal(a, b)
    size = np.abs(b, where=np.isfinite(b), out=np.zeros(np.shape(b))).max(initial=0.0)
    return np.allclose(a, b, rtol=0.0, atol=within * size, equal_nan=True)


def _of_sequence(a, b, at, seen, within) -> Iterator[str]:
    if len(a) != len(b):
        yield f"{at}: {len(a)} items, {len(b)}"
        return
    for k, (x, y) in enumerate(zip(a, b, strict=True)):
        yield from _differing(x, y, f"{at}[{k}]", seen, within)


def _attributes(a) -> Iterator[tuple[str, object]]:
    yield from getattr(a, "__dict__", {}).items()
