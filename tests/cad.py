"""Files that gmsh writes: meshes, and parts as CAD."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest


@contextmanager
def session(**options: float) -> Iterator[Any]:
    """A session of gmsh that says nothing, with options of its meshes."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        for name, value in options.items():
            gmsh.option.setNumber(f"Mesh.{name}", value)
        yield gmsh
    finally:
        gmsh.finalize()


def saved(path: Path, build: Callable[[Any], object], **options: float) -> Path:
    """Write what a function of gmsh's model makes, with options of meshes; the path."""
    with session(**options) as gmsh:
        build(gmsh.model)
        gmsh.write(str(path))
    return path
