"""How a demo ends: files written on rank 0."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rigidfx.base.text_files import write_text
from rigidfx.command.options import say
from rigidfx.plot import Shapes

from .start import comm


def draw(shapes: Shapes, path: Path, **how: Any) -> None:
    """Draw shapes, if there are any: a run that was over has none to add. Collective."""
    if shapes.count:
        shapes.draw(path, **how)
    else:
        say(f"The run was over before: no shapes for {path}")


def write(path: Path, text: str) -> None:
    """Write a file, and its folder if need be; a failure is one of all ranks. Collective."""
    write_text(comm, path, text)
