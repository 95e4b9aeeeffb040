"""Labels of a CAD file's volumes and surfaces: the names of their parts.

gmsh joins the names of assemblies, their pieces and parts by "/": "Shapes/machine/3/M8/20". The
part's name is the last of them, but for names that have a "/" themselves; these are in the file.
"""

from __future__ import annotations

import re
from typing import Any

from rigidfx.domain.gmsh_groups import name_of

__all__ = ["labels_of"]

# Letters that STEP writes in other ways: X2, X4 and X by numbers, S by another one, ' twice.
ESCAPE = r"\\X[24]\\[0-9A-F]*\\X0\\|\\X\\[0-9A-F]{2}|\\S\\.|\\P[A-I]\\|''|\\\\"


def labels_of(gmsh: Any, text: str) -> dict[tuple[int, int], str]:
    """The label of each entity of gmsh's model, by dimension and number; "" where it has none.

    Args:
        gmsh: The module; its model is the content of the file.
        text: The file.
    """
    model = gmsh.model
    given = {each: name_of(model.getEntityName, *each) for each in model.getEntities()}
    if not any(given.values()):
        return given
    strings = re.findall(r"'((?:[^'/]|'')*/(?:[^']|'')*)'", text)
    with_slash = [
        re.compile("/(" + ".+?".join(map(re.escape, re.split(ESCAPE, each))) + ")$", re.DOTALL)
        for each in sorted(set(strings), key=len, reverse=True)
    ]
    return {each: _last(name, with_slash) for each, name in given.items()}


def _last(name: str, with_slash: list[re.Pattern[str]]) -> str:
    """The last of the names that are joined."""
    found = (match[1] for each in with_slash if (match := each.search(name)))
    return next(found, name.split("/")[-1])
