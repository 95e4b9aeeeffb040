"""How a demo ends: files written on rank 0, its summary printed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rigidfx.base.text_files import write_text

from .start import comm, say


def write(path: Path, text: str) -> None:
    """Write a file, and its folder if need be; a failure is one of all ranks. Collective."""
    write_text(comm, path, text)


def write_json(path: Path, content: Any, indent: int | None = 2) -> str:
    """Write numbers and names as JSON, and return what was written. Collective."""
    text = json.dumps(content, indent=indent, ensure_ascii=False) + "\n"
    write(path, text)
    return text


def conclude(folder: Path, summary: Any) -> None:
    """Leave `summary.json` in a folder, and print it. Collective."""
    say(write_json(folder / "summary.json", summary).rstrip())
