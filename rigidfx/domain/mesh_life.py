"""When a mesh goes: never while an exception is under way.

As a mesh goes, mpi4py is called for its communicator. In `simulate(Scene(box(...), material),
t_end=1)` the scene is dropped while a TypeError is on its way; mpi4py would take that error for its
own and keep a lock (4.0), for which the process waits at its end, for ever. Function spaces, forms
and all else that is made on a mesh hold it as well, and may be the last to do so.

So a reference to each mesh is kept here, and meshes that nothing else refers to any more are let go
when the next domain is made or dropped, or at the process's end. A finaliser is as good a time as
any other: in it Python sets exceptions aside.
"""

from __future__ import annotations

import atexit
import sys
from typing import Any

__all__ = ["keep", "kept", "let_go"]

_kept: list[Any] = []


def _references(items: list[Any], k: int) -> int:
    return sys.getrefcount(items[k])


ALONE = _references([object()], 0)  # of what only a list refers to, however Python counts


def keep(mesh: Any) -> None:
    """Have a mesh outlive what is made on it; let others go whose time has come.

    Args:
        mesh: A DOLFINx mesh.
    """
    let_go()
    # The object of C++, which function spaces and forms refer to as well.
    if not any(mesh._cpp_object is other for other in _kept):
        _kept.append(mesh._cpp_object)


def kept() -> int:
    """Number of meshes that are kept."""
    return len(_kept)


def let_go() -> None:
    """Drop the meshes that nothing else refers to."""
    k = 0
    while k < len(_kept):
        if _references(_kept, k) <= ALONE:
            del _kept[k]
        else:
            k += 1


atexit.register(_kept.clear)
