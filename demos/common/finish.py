"""How a demo ends: files written on rank 0."""

from __future__ import annotations

from pathlib import Path

from rigidfx.base.text_files import write_text

from .start import comm


def write(path: Path, text: str) -> None:
    """Write a file, and its folder if need be; a failure is one of all ranks. Collective."""
    write_text(comm, path, text)
