"""A slider-crank: a crankshaft of two webs, a slim rod with two eyes, a heavy block that slides.

The crank turns about z, the block slides along x. All parts lie as at the outer dead centre, and
touch nowhere: the rod's big eye is round the pin between the webs, its small eye in a slot of the
block. Webs, rod and block have holes; the rod's shank meets its eyes with fillets.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx import Domain, from_gmsh

__all__ = ["FILLET", "LENGTH", "RADIUS", "slider_crank"]

RADIUS, LENGTH = 0.05, 0.2  # m; of the crank, and of the rod from pin to pin
WEB = 0.07, 0.014, 0.034  # m; radius of a web, its inner and its outer side
JOURNAL = 0.018, 0.054  # m; radius, and where it ends along z
PIN, WRIST = 0.014, 0.009  # m; radii of the crank pin and of the wrist pin's holes
EYES = 0.024, 0.018  # m; outer radii of the rod's eyes
ROD = 0.012, 0.010  # m; width of the shank, and half of the rod's thickness
ROUND = 0.010  # m; radius of the fillets
BLOCK = (-0.03, 0.07), 0.040, 0.035  # m; along x from the wrist pin, half of its width and height
SLOT = 0.025, 0.012  # m; depth of the slot from the wrist pin on, half of its height
# A fillet at the small eye, where the shank begins to widen.
FILLET = RADIUS + LENGTH - 0.023, 0.98 * ROD[0] / 2, 0.0

Array = npt.NDArray[np.float64]


def slider_crank(
    size: float = 0.012, rod_size: float = 0.006, comm: MPI.Comm = MPI.COMM_WORLD
) -> Domain:
    """The three parts of tetrahedra. Collective.

    Cells are named "crank", "rod" and "block"; facets "journals" (both ends of the shaft), "pin",
    "big eye", "small eye", "wrist" (the holes in the block) and "slides" (the block's two sides).

    Args:
        size: Largest edge of a cell [m].
        rod_size: The same in the rod.
        comm: Communicator of the mesh.
    """
    return from_gmsh(lambda gmsh: _build(gmsh, size, rod_size), comm)


def _build(gmsh: Any, size: float, rod_size: float) -> None:
    """Each part by itself: solids that are united, rounded and drilled."""
    model, occ = gmsh.model, gmsh.model.occ
    parts = {"crank": _crank(occ), "rod": _rod(model, occ), "block": _block(occ)}
    occ.synchronize()
    for name, tag in parts.items():
        model.addPhysicalGroup(3, [tag], name=name)
    end = RADIUS + LENGTH
    _surface(model, "journals", parts["crank"], (0, 0), JOURNAL[0], (WEB[2], JOURNAL[1]))
    _surface(model, "pin", parts["crank"], (RADIUS, 0), PIN, (0, WEB[1]))
    _surface(model, "big eye", parts["rod"], (RADIUS, 0), PIN, (0, ROD[1]))
    _surface(model, "small eye", parts["rod"], (end, 0), WRIST, (0, ROD[1]))
    _surface(model, "wrist", parts["block"], (end, 0), WRIST, (SLOT[1], BLOCK[2]))
    sides = []
    for _, face in model.getBoundary([(3, parts["block"])], oriented=False):
        box = model.getBoundingBox(2, face)
        if box[4] - box[1] < 1e-4 and abs(box[1]) > BLOCK[1] - 1e-4:
            sides.append(face)
    model.addPhysicalGroup(2, sides, name="slides")
    fine = model.mesh.field.add("Constant")
    model.mesh.field.setNumbers(fine, "VolumesList", [parts["rod"]])
    model.mesh.field.setNumber(fine, "VIn", rod_size)
    model.mesh.field.setNumber(fine, "VOut", size)
    model.mesh.field.setAsBackgroundMesh(fine)
    for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)
    model.mesh.generate(3)


def _cylinder(occ: Any, x: float, y: float, radius: float, low: float, high: float) -> int:
    """A solid along z."""
    return int(occ.addCylinder(x, y, low, 0, 0, high - low, radius))


def _united(occ: Any, tags: list[int], holes: list[int]) -> int:
    """Solids as one, less others."""
    out = [(3, tags[0])]
    if tags[1:]:
        out, _ = occ.fuse(out, [(3, tag) for tag in tags[1:]])
    out, _ = occ.cut(out, [(3, tag) for tag in holes])
    return int(out[0][1])


def _crank(occ: Any) -> int:
    """Webs, pin and journals, with three holes in each web."""
    webs = [_cylinder(occ, 0, 0, WEB[0], *ends) for ends in (WEB[1:], (-WEB[2], -WEB[1]))]
    shafts = [
        _cylinder(occ, 0, 0, JOURNAL[0], *ends)
        for ends in ((WEB[2], JOURNAL[1]), (-JOURNAL[1], -WEB[2]))
    ]
    pin = _cylinder(occ, RADIUS, 0, PIN, -WEB[1], WEB[1])
    angles = np.deg2rad((110.0, 180.0, 250.0))
    holes = [
        _cylinder(occ, 0.044 * np.cos(a), 0.044 * np.sin(a), 0.012, -WEB[2], WEB[2]) for a in angles
    ]
    return _united(occ, [*webs, pin, *shafts], holes)


def _rod(model: Any, occ: Any) -> int:
    """Two eyes and a shank, rounded where they meet."""
    low, high, end = -ROD[1], ROD[1], RADIUS + LENGTH
    eyes = [
        _cylinder(occ, x, 0, radius, low, high)
        for x, radius in zip((RADIUS, end), EYES, strict=True)
    ]
    shank = int(occ.addBox(RADIUS, -ROD[0] / 2, low, LENGTH, ROD[0], high - low))
    body = _united(occ, [*eyes, shank], [_cylinder(occ, RADIUS, 0, PIN, low, high)])
    occ.synchronize()
    corners = []
    for _, edge in model.getBoundary(
        model.getBoundary([(3, body)], oriented=False), combined=False, oriented=False
    ):
        x0, y0, z0, x1, y1, z1 = model.getBoundingBox(1, edge)
        at_shank = abs(abs(y0 + y1) - ROD[0]) < 1e-4 and y1 - y0 < 1e-4
        if at_shank and x1 - x0 < 1e-4 and z1 - z0 > ROD[1]:
            corners.append(edge)
    out = occ.fillet([body], sorted(set(corners)), [ROUND])
    out, _ = occ.cut(out, [(3, _cylinder(occ, end, 0, WRIST, low, high))])
    return int(out[0][1])


def _block(occ: Any) -> int:
    """A block with a slot for the rod's small eye, the wrist pin's hole, and a hole along y."""
    (back, front), width, height = BLOCK
    end = RADIUS + LENGTH
    body = int(occ.addBox(end + back, -width, -height, front - back, 2 * width, 2 * height))
    slot = int(occ.addBox(end + back, -width, -SLOT[1], SLOT[0] - back, 2 * width, 2 * SLOT[1]))
    wrist = _cylinder(occ, end, 0, WRIST, -height, height)
    bore = int(occ.addCylinder(end + 0.045, -width, 0, 0, 2 * width, 0, 0.010))
    return _united(occ, [body], [slot, wrist, bore])


def _surface(
    model: Any,
    name: str,
    part: int,
    at: tuple[float, float],
    radius: float,
    span: tuple[float, float],
) -> None:
    """Name the surfaces of a part that lie on a cylinder along z.

    Args:
        model: gmsh's.
        name: The name.
        part: The part's solid.
        at: x and y of the axis [m].
        radius: The cylinder's [m].
        span: Least and largest |z| of them [m].
    """
    found = []
    for _, face in model.getBoundary([(3, part)], oriented=False):
        x0, y0, z0, x1, y1, z1 = model.getBoundingBox(2, face)
        inside = (
            max(abs(x0 - at[0]), abs(x1 - at[0]), abs(y0 - at[1]), abs(y1 - at[1])) < radius + 1e-4
        )
        least = min(abs(z0), abs(z1)) if z0 * z1 > 0 else 0.0
        along = least > span[0] - 1e-4 and max(abs(z0), abs(z1)) < span[1] + 1e-4
        if inside and along and z1 - z0 > 1e-4:
            found.append(face)
    model.addPhysicalGroup(2, found, name=name)
