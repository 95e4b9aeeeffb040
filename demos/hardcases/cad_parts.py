"""Parts from CAD: cells of both kinds, orders and masses, found rigid by every criterion."""

from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import Any

import rigidfx as rf

from .case import Run, case

STEEL_LIKE = rf.StVenantKirchhoff(E=2e7, nu=0.3, rho=1000.0)
PULL = rf.Traction("right", (2e3, 0.0, 0.0), until=0.5)
BEND = rf.Traction("right", (0.0, 0.0, 2e2), until=0.5)


def lug(size: float, cell: str = "tetrahedron") -> rf.Domain:
    """A bar of 8 m × 1 m × 1 m that ends in a block of 2 m × 3 m × 3 m."""
    return rf.from_gmsh(partial(_lug, size, cell))


def _lug(size: float, cell: str, gmsh: Any) -> None:
    model, occ = gmsh.model, gmsh.model.occ
    bar, block = occ.addBox(0, 0, 0, 8, 1, 1), occ.addBox(8, -1, -1, 2, 3, 3)
    occ.fuse([(3, bar)], [(3, block)])
    occ.synchronize()
    model.addPhysicalGroup(3, [tag for _, tag in model.getEntities(3)], name="body")
    for name, x in (("left", 0.0), ("right", 10.0)):
        ends = [t for _, t in model.getEntities(2) if abs(occ.getCenterOfMass(2, t)[0] - x) < 1e-6]
        model.addPhysicalGroup(2, ends, name=name)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    # Each tetrahedron in four hexahedra.
    gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 2 if cell == "hexahedron" else 0)
    model.mesh.generate(3)


def lug_scene(
    size: float, order: int, mass: str, load: rf.effects.Effect = PULL, cell: str = "tetrahedron"
) -> rf.Scene:
    """The lug, fixed at one end and loaded at the other for half a second."""
    effects = [rf.Fixed("left"), load, rf.NumericalDamping(0.02)]
    probes = {"tip": (10.0, 0.5, 0.5)}
    return rf.Scene(lug(size, cell), STEEL_LIKE, effects, order=order, mass=mass, probes=probes)


@case("CAD", "masses of ten-node tetrahedra are negative at their vertices")
def parts_of_tetrahedra(short: bool) -> Iterator[Run]:
    """The balance of energy to Newton's tolerance, and no estimate fails.

    Whether a part freezes depends on size and tolerance; that all of them end is the case.
    """
    sizes = ((0.7, 0.05),) if short else ((0.7, 0.05), (0.5, 0.05), (0.4, 0.1))
    kinds = ((2, "consistent"),) if short else (
        (2, "consistent"), (1, "consistent"), (1, "lumped"))  # fmt: skip
    loads = (("pulled", PULL),) if short else (("pulled", PULL), ("bent", BEND))
    tolerances = (0.1,) if short else (0.3, 0.1, 0.03)
    for (size, dt), (order, mass), (way, load) in product(sizes, kinds, loads):
        scene = lug_scene(size, order, mass, load)
        name = f"{way}, size {size:g}, order {order}, {mass}"
        for tol in tolerances:
            rate = rf.StrainRate(rf.Relative(tol), window=1.0)
            t_end = 3.0 if short else 6.0
            yield Run(f"{name}, {tol:g}", scene, dt, t_end, rate, momentum=None, freezes=None)
        if not short:
            asked = rf.Accuracy(0.05, at="tip")
            yield Run(f"{name}, 5 %", scene, dt, 6.0, asked, momentum=None, freezes=None, cuts=9)


@case("CAD", "hexahedra of a CAD part, of any shape")
def parts_of_hexahedra(short: bool) -> Iterator[Run]:
    """As parts of tetrahedra."""
    kinds = ((1, "lumped"),) if short else ((1, "lumped"), (1, "consistent"), (2, "consistent"))
    for order, mass in kinds:
        scene = lug_scene(3.0, order, mass, cell="hexahedron")
        rate = rf.StrainRate(rf.Relative(0.1), window=1.0)
        t_end = 2.0 if short else 6.0
        name = f"pulled, order {order}, {mass}"
        yield Run(name, scene, 0.05, t_end, rate, momentum=None, freezes=None)
        if not short:
            asked = rf.Accuracy(0.05, at="tip")
            yield Run(f"{name}, 5 %", scene, 0.05, 6.0, asked, momentum=None, freezes=None, cuts=9)
