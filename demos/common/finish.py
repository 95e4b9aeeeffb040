"""How a demo ends: files written on rank 0, its summary printed, curves of its reports."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rigidfx as rf
from rigidfx.base.text_files import write_text
from rigidfx.plot import Curve

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


def curve(label: str, reports: Sequence[rf.Report], name: str) -> Curve:
    """A number of the reports, by its name, against time."""
    return Curve(label, [r.t for r in reports], [getattr(r, name) for r in reports])
