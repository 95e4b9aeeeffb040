"""Runs a tutorial as a notebook: python3 docs/notebooks.py PAGE NOTEBOOK; build.py calls it.

jupytext makes the Python blocks of a page the notebook's cells. They run in an empty folder.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import jupytext
import nbformat
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient

PATIENCE = 1800  # s, of one cell
# Messages of gmsh and values that a script would not print are no outputs.
QUIET = [
    "--IPKernelApp.capture_fd_output=False",
    "--InteractiveShell.ast_node_interactivity=none",
]


def notebook_of(page: Path, place: Path) -> Any:
    """The notebook of a page, for a folder: its links lead to the same pages from there."""

    def moved(link: re.Match[str]) -> str:
        target = os.path.relpath(page.parent / link[1], place)
        return f"]({target}{link[2] or ''})"

    text = re.sub(r"\]\((?!\w+:|#)([^)#]+)(#[^)]*)?\)", moved, page.read_text("utf-8"))
    notebook = jupytext.reads(text, fmt="md")
    notebook.metadata.kernelspec = {"name": "python3", "display_name": "Python 3"}
    return notebook


def run(notebook: Any) -> None:
    """Fill in the outputs of all cells, from an empty folder; raises if a cell fails."""
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as sockets:
        os.environ["JUPYTER_RUNTIME_DIR"] = sockets
        place = {"transport": "ipc", "ip": f"{sockets}/kernel"}
        kernel = AsyncKernelManager(kernel_name="python3", **place)
        where = {"metadata": {"path": folder}}
        client = NotebookClient(notebook, kernel, timeout=PATIENCE, resources=where)
        client.extra_arguments = QUIET
        client.execute(cleanup_kc=True)


if __name__ == "__main__":
    page, path = map(Path, sys.argv[1:])
    path.parent.mkdir(parents=True, exist_ok=True)
    notebook = notebook_of(page, path.parent)
    run(notebook)
    nbformat.write(notebook, path)
