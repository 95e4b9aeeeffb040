"""Files that a command leaves, written on rank 0."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mpi4py import MPI

from rigidfx.base.text_files import write_text
from rigidfx.command.parser import say

__all__ = ["conclude", "write_json"]


def write_json(path: Path, content: Any, indent: int | None = 2) -> str:
    """Write numbers and names as JSON, and return them. Collective.

    Raises:
        OutputError: On every rank, if the file cannot be written.
    """
    text = json.dumps(content, indent=indent, ensure_ascii=False) + "\n"
    write_text(MPI.COMM_WORLD, path, text)
    return text


def conclude(folder: Path, summary: Any) -> None:
    """Leave `summary.json` in a folder, and print it. Collective.

    Raises:
        OutputError: On every rank, if the file cannot be written.
    """
    say(write_json(folder / "summary.json", summary).rstrip())
