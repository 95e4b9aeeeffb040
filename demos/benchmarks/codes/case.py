"""Two structures under loads that end, and the numbers that a code gives for them."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt
from bench import ENDS, RAMP, pushed_l
from dolfinx.cpp.io import perm_vtk

import rigidfx as rf
from meshes.tumbling_l import tumbling_l

Array = npt.NDArray[np.float64]
BRACKET = Path(__file__).resolve().parents[3] / "meshes" / "bracket.geo"
STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7800.0)  # Pa, 1, kg/m³
MIRRORED = [0, 2, 1, 3, 6, 5, 4, 7, 9, 8]  # a tetrahedron of ten nodes in VTK's order


@dataclass(frozen=True)
class Case:
    """A structure of one material that some tractions push for a while; on one rank."""

    name: str  # beginning with "soft" or "metal"
    scene: rf.Scene  # the problem as rigidfx has it
    tractions: dict[str, Array]  # their values at factor one, by the name of their facets [Pa]
    factor: rf.Table  # their common factor in time; zero at its end and from there on
    held: str | None  # name of the facets that do not move; None of a free body
    dt: float  # time step [s]
    steps: int  # how many
    probe: int  # number of the node that is compared

    @property
    def material(self) -> rf.StVenantKirchhoff:
        """Of all cells."""
        [(material, _)] = self.scene.materials
        return material  # type: ignore[return-value]

    @property
    def unknowns(self) -> int:
        """Three for each node that moves."""
        return 3 * (len(self.nodes) - len(self.held_nodes))

    @property
    def free_from(self) -> float:
        """The end of the loads [s]."""
        return float(self.factor.times[-1])

    @cached_property
    def nodes(self) -> Array:
        """Positions, shape (nodes, 3) [m]."""
        return self.scene.space.tabulate_dof_coordinates()

    @cached_property
    def cells(self) -> npt.NDArray[np.int32]:
        """Numbers of their nodes in VTK's order, shape (cells, 8 or 10)."""
        of_cells = self.scene.space.dofmap.list
        order = np.argsort(perm_vtk(self.scene.mesh.topology.cell_type, of_cells.shape[1]))
        cells = of_cells[:, order]
        if self.scene.simplex:  # DOLFINx turns tetrahedra as it likes, others do not
            a, b, c = (self.nodes[cells[:, k]] - self.nodes[cells[:, 0]] for k in (1, 2, 3))
            left = np.einsum("ci,ci->c", np.cross(a, b), c) < 0
            cells[left] = cells[left][:, MIRRORED]
        return cells

    @cached_property
    def forces(self) -> Array:
        """Of the nodes at factor one, shape (nodes, 3) [N]."""
        weights = {name: self.scene.facet_weights(name, "peers") for name in self.tractions}
        return sum(np.outer(weights[name], t) for name, t in self.tractions.items())  # type: ignore

    @cached_property
    def held_nodes(self) -> npt.NDArray[np.int32]:
        """Their numbers."""
        if self.held is None:
            return np.empty(0, np.int32)
        return self.scene.nodes(self.held, "peers")


@dataclass
class Outcome:
    """What a code did with a case."""

    seconds: list[float] = field(default_factory=list)  # wall time of steps [s]
    newton: list[int] = field(default_factory=list)  # Newton iterations of each step
    times: list[float] = field(default_factory=list)  # ends of steps [s]
    energies: list[float] = field(default_factory=list)  # kinetic and stored energy there [J]
    probe: Array | None = None  # where the case's probe is at the last of them [m]
    solver: str = ""  # its linear solver
    failed: str = ""  # why it ended too early, if it did

    def drift(self, case: Case) -> float | None:
        """Largest change of the energy after the loads, relative; None if it ended before."""
        free = np.array(self.times) >= case.free_from - case.dt / 2
        H = np.array(self.energies)[free]
        return float(np.abs(H - H[0]).max() / H[0]) if H.size > 1 else None


def soft_l(refine: int, steps: int, dt: float = 0.1) -> Case:
    """Simo and Tarnow's L, first-order hexahedra of edge 1/refine; 672 unknowns at 1.

    It is free, pushed for 5 s and turns by some 0.1 rad in a step of 0.1 s.
    """
    scene = pushed_l(tumbling_l(refine), time=RAMP)
    probe = nearest(scene, (0.0, 10.0, 0.0))
    return Case("soft L", scene, ENDS, RAMP, None, dt, steps, probe)


def metal_bracket(size: float, steps: int, dt: float = 1e-4) -> Case:
    """A bracket of steel on a wall, second-order tetrahedra; its end is pushed for 2 ms.

    Cells of 0.02 m give 4000 unknowns.
    """
    domain = rf.read_geo(BRACKET, {"size": size})
    tractions = {"end": np.array([0.0, 0.0, -2e5])}
    factor = rf.Table([0.0, 1e-3, 2e-3], [0.0, 1.0, 0.0])
    scene = rf.Scene(
        domain,
        STEEL,
        [rf.Fixed("wall"), *(rf.Traction(n, tuple(t), time=factor) for n, t in tractions.items())],
        order=2,
        mass="consistent",
    )
    probe = nearest(scene, (0.2, 0.03, 0.04))
    return Case("metal bracket", scene, tractions, factor, "wall", dt, steps, probe)


def nearest(scene: rf.Scene, point: tuple[float, float, float]) -> int:
    """Number of the node next to a point."""
    return int(np.linalg.norm(scene.space.tabulate_dof_coordinates() - point, axis=1).argmin())
