"""Drop the green lines that OpenCASCADE writes to the process's standard output.

It has no option for that. Lines that other threads print meanwhile are dropped, too.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any


@contextmanager
def silent() -> Iterator[None]:
    """Drop all that is written to the process's standard output."""
    try:
        sys.stdout.flush()
        kept = os.dup(1)
    except (OSError, ValueError, AttributeError):  # there is none
        yield
        return
    try:
        with open(os.devnull, "wb") as nothing:
            os.dup2(nothing.fileno(), 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


@contextmanager
def silent_files(gmsh: Any) -> Iterator[None]:
    """Let a function of a user read and write files in silence; what it prints itself stays."""
    calls = (gmsh, "open"), (gmsh, "merge"), (gmsh, "write"), (gmsh.model.occ, "importShapes")
    own = [getattr(owner, name) for owner, name in calls]
    try:
        for (owner, name), call in zip(calls, own, strict=True):
            setattr(owner, name, _silenced(call))
        yield
    finally:
        for (owner, name), call in zip(calls, own, strict=True):
            setattr(owner, name, call)


def _silenced(call: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(call)
    def quiet(*given: Any, **named: Any) -> Any:
        with silent():
            return call(*given, **named)

    return quiet
