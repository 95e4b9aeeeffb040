"""Have OpenCASCADE read a CAD file: in UTF-8, in silence, and only if it is whole.

A STEP file that was cut short names entities that are not there, and OpenCASCADE ends Python over
some of them.
"""

from __future__ import annotations

import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rigidfx.base.errors import SceneError
from rigidfx.base.text_files import decoded
from rigidfx.domain.cad_labels import labels_of
from rigidfx.domain.silence import silent

__all__ = ["import_shapes"]


def import_shapes(gmsh: Any, path: str | Path) -> dict[tuple[int, int], str]:
    """Add the shapes of a file to gmsh's model; their labels by dimension and number.

    Args:
        gmsh: The module.
        path: A STEP, IGES or BREP file.

    Raises:
        SceneError: If a STEP file is not whole.
    """
    data = Path(path).read_bytes()
    text = decoded(data)
    if Path(path).suffix.lower() in (".step", ".stp"):
        _check_whole(path, text)
    with TemporaryDirectory() as folder, silent():
        copy = Path(path)
        if not (text.isascii() or text.encode() == data):  # OpenCASCADE would mix letters up
            copy = Path(folder, copy.name)
            copy.write_bytes(text.encode())
        gmsh.model.occ.importShapes(str(copy))
        gmsh.model.occ.synchronize()
    return labels_of(gmsh, text)


def _check_whole(path: str | Path, text: str) -> None:
    """Refuse a STEP file that names entities that it has not."""
    plain = re.sub(r"'(?:[^']|'')*'|/\*.*?\*/", "", text, flags=re.DOTALL)
    there = set(re.findall(r"#(\d+)\s*=", plain))
    lost = set(re.findall(r"#(\d+)", plain)) - there
    if lost:
        raise SceneError(
            f"'{path}' is damaged: it names entities that are not in it, such as "
            f"#{min(lost, key=int)}. Export it once more."
        )
