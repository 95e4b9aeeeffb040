"""The whole problem, immutable and validated: mesh, materials, effects, discretisation.

Faults known without a run are raised as a scene is made, the rest before the first step.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal

import dolfinx.mesh as dmesh
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from mpi4py import MPI

from rigidfx import effects as fx
from rigidfx.base import compat
from rigidfx.base.errors import SceneError
from rigidfx.base.in_notebook import as_text
from rigidfx.base.inputs import positive, whole
from rigidfx.base.sealed import read_only
from rigidfx.base.taken import check_same
from rigidfx.base.types import Array, Indices, Ints
from rigidfx.domain.connected import ConnectedParts, connected_parts
from rigidfx.domain.domain import Domain, box_of
from rigidfx.effects.base import ANY_SET
from rigidfx.effects.joints.joint import cut_by_symmetry
from rigidfx.mechanics.element import Element
from rigidfx.mechanics.enhanced import AssumedStrains
from rigidfx.mechanics.materials import Material
from rigidfx.mechanics.schemes import Scheme, scheme_of
from rigidfx.scene import checks
from rigidfx.scene.cells import assign, element_of
from rigidfx.scene.doubts import warn_of_facets, warn_of_units
from rigidfx.scene.mesh_checks import warn_of_mesh
from rigidfx.scene.pieces import divide, warn_of_pieces
from rigidfx.scene.summary import description, in_a_line
from rigidfx.scene.weights import inertial_masses, nodal_weights, point_masses

MUCH = 1e8  # ratio of stiffness from which on rounding of a stiff part's forces is looked at


class Scene:
    """A problem of structural dynamics, made of values as they are now; arrays are read-only.

    Attributes:
        domain: Mesh and names, those of pieces that are a rigid body each among them.
        pieces: How many bodies each name of these stands for.
        materials: Pairs of a material and its owned cells, of this rank; together they cover the
            mesh. A rank may have no cells of a material.
        material_sets: Of each of them the name of its set of cells, "" where there is but one.
        effects: All effects as given, a `Rigid` for each piece.
        order: Order of the Lagrange displacement.
        mass: "lumped" (diagonal, default) or "consistent".
        scheme: Time integration scheme.
        space, cell_space: Functions of displacement and velocity; piecewise constant ones.
        nodal_mass: ∫ ρ0 Nᵢ dV and point masses per local node with ghosts, shape (nodes,) [kg].
        averaging_mass: |∫ ρ0 Nᵢ dV| and point masses, positive for fits over a few nodes [kg].
        start_places: Places of the local nodes at the start, before a preload [m].
        point_masses: The point masses in it [kg].
        element: How its cells strain.
        supports: Pairs of a support and its local nodes, ghosts included.
        probes: Named points [m] whose histories are recorded.
        probe_cells: Rank and local number of the cell that holds each of them.
        given: The arguments it was made of, by name.
    """

    def __init__(
        self,
        domain: Domain,
        material: Material | Mapping[str, Material],
        effects: Sequence[fx.Effect] = (),
        *,
        order: int = 1,
        mass: Literal["lumped", "consistent"] = "lumped",
        scheme: Scheme | None = None,
        element: str | AssumedStrains = "standard",
        probes: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        """Validate the problem. Collective.

        Args:
            domain: Mesh and names.
            material: One material, or one for each of the named cell sets that make up the mesh.
            effects: The effects, in any order.
            order: 1 or 2. Sound with lumped mass: hexahedra of both orders (their nodal masses
                are those of a Gauss-Lobatto rule, which keeps the order) and tetrahedra of order
                1. Tetrahedra of order 2 have negative lumped masses at their vertices and need
                the consistent matrix.
            mass: "lumped" or "consistent", for the whole run.
            scheme: EnergyMomentum() if None; Midpoint() or Trapezoidal() otherwise.
            element: "enhanced" lets hexahedra of order 1 bend and shear without locking, and so
                does AssumedStrains(…) if they are thin and curved, too; "standard" does not.
            probes: Name → reference point [m].

        Raises:
            SceneError: If anything in it is unknown, impossible or in conflict.
        """
        self.domain, self.effects = domain, checks.effects_of(domain, effects)
        self.given = {"order": order, "mass": mass, "scheme": scheme, "element": element}
        own = {
            "material": checks.in_order(material),
            "probes": checks.in_order(probes),
            "effects": self.effects,
        }
        self.given |= own | {"names": sorted(domain.sets)}
        check_same(domain.comm, "Scene", self.given)
        self.order, self.mass, self.scheme = order, mass, scheme_of(scheme)
        self.probes = MappingProxyType(checks.points(domain.comm, probes or {}))
        self.probe_cells = checks.cells_of(domain.mesh, self.probes)
        checks.check_discretisation(self)
        checks.check_together(self.effects, self.scheme)
        self._assign(material, element)
        self._weigh()
        self._check_effects()

    def _assign(self, material: Any, element: Any) -> None:
        """Give cells their materials and element, and pieces of Rigid parts names. Collective."""
        self.domain, self.effects, self.pieces = divide(self.domain, self.effects)
        self.materials = assign(self.domain, material)
        self.element: Element = element_of(self, element)
        sets = tuple(material) if isinstance(material, Mapping) else ("",)
        self.material_sets: tuple[str, ...] = self.comm.bcast(sets)
        checks.warn_of_locking(self)

    def _weigh(self) -> None:
        """Set nodes up, and their masses. Collective."""
        self.space = fem.functionspace(self.mesh, ("Lagrange", self.order, (3,)))
        self.start_places = read_only(fx.places_at_start(self))
        self.cell_space = fem.functionspace(self.mesh, ("DG", 0))
        self.point_masses = read_only(point_masses(self))
        own = self.cell_weights(self.density(), self.owned_cells(None, "Scene"))
        self.nodal_mass = read_only(own + self.point_masses)
        self.averaging_mass = read_only(np.abs(own) + self.point_masses)
        checks.check_masses(self)

    def _check_effects(self) -> None:
        """Look the effects up on the mesh, supports first. Collective."""
        self.effects = tuple(effect.placed(self) for effect in self.effects)
        supports = self.named(fx.Support)
        held = tuple((s, self.nodes(s.where, s.kind)) for s in supports)
        joints, held = cut_by_symmetry(self, held)
        self.effects += joints
        self.supports = tuple((s, read_only(nodes)) for s, nodes in held)
        checks.check_supports(self)
        for effect in self.effects:
            effect.check(self)
        checks.check_rigid(self)
        warn_of_pieces(self.domain, self.effects)
        warn_of_mesh(self.domain, self.effects, self.order)
        warn_of_facets(self)
        warn_of_units(self)

    # Questions to a scene -----------------------------------------------------------------------

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the mesh."""
        return self.domain.comm

    @property
    def mesh(self) -> dmesh.Mesh:
        """The mesh."""
        return self.domain.mesh

    @property
    def owned_nodes(self) -> int:
        """Number of nodes this rank owns; they come first in all nodal arrays."""
        return int(self.space.dofmap.index_map.size_local)

    @property
    def quadrature_degree(self) -> int:
        """Degree of the rule of W, H and the residual: full integration of the stiffness.

        In first-order tetrahedra the strain is constant, and one point is enough.
        """
        return 1 if self.simplex and self.order == 1 else 2 * self.order

    @property
    def cell_measure(self) -> ufl.Measure:
        """The measure of W, H and the residual over cells."""
        degree = {"quadrature_degree": self.quadrature_degree}
        return ufl.Measure("dx", domain=self.mesh, metadata=degree)

    @property
    def boundary_measure(self) -> ufl.Measure:
        """The measure of follower loads: exact for the moments of a closed surface."""
        degree = {"quadrature_degree": 4 * self.order}
        return ufl.Measure("ds", domain=self.mesh, metadata=degree)

    def named(self, kind: type[fx.Effect]) -> tuple[Any, ...]:
        """The effects of a kind, in the order given."""
        return tuple(e for e in self.effects if isinstance(e, kind))

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Sorted instants at which steps must end [s]."""
        return tuple(sorted({t for e in self.named(fx.Windowed) for t in e.breakpoints}))

    @property
    def bends(self) -> Mapping[float, float]:
        """Breakpoints at which loads go on without a jump: change of slope by instant [1/s].

        The change is that of the load's factor over its largest value, the largest of all loads.
        """
        return fx.bends_of(self.named(fx.Windowed))

    def acting(self, t: float) -> tuple[fx.Windowed, ...]:
        """The effects with a time window that act at t [s]."""
        return tuple(e for e in self.named(fx.Windowed) if e.acts(t))

    def nodes(self, name: str | None, by: str, dims: Sequence[int] = ANY_SET) -> Indices:
        """Local nodes in the closure of a named set, or all; ghosts included. Collective."""
        if name is None:
            return np.arange(len(self.space.tabulate_dof_coordinates()), dtype=np.int32)
        found = self.domain.find(name, dims, by)
        self.mesh.topology.create_connectivity(found.dim, 3)
        dofs = fem.locate_dofs_topological(self.space, found.dim, found.entities, remote=True)
        return np.sort(dofs).astype(np.int32)

    def shares(self, name: str, wanted_by: str) -> Array:
        """Equal parts of 1 for the nodes of a named set, per local node with ghosts. Collective."""
        parts = self.members(name, wanted_by)[:, 0]
        return parts / self.sum(parts[: self.owned_nodes].sum())

    def members(self, name: str | None, wanted_by: str) -> Array:
        """1 at local nodes of a named set, or all, 0 elsewhere, shape (nodes, 1). Collective."""
        members = np.zeros(len(self.space.tabulate_dof_coordinates()))
        members[self.nodes(name, wanted_by)] = 1.0
        return members[:, None]

    def boundary(self, name: str, wanted_by: str) -> Indices:
        """Owned cell and local number of each facet of a named set, shape (n, 2). Collective.

        `SceneError` if the set is unknown, or has facets that lie inside the mesh.
        """
        found = self.domain.find(name, (2,), wanted_by)
        pairs = compat.integration_facets(self.mesh, found.entities).reshape(-1, 2)
        if (inner := self.domain.count(found) - self.sum(len(pairs))) > 0:
            raise SceneError(
                f"{wanted_by} on '{name}': {int(inner)} of its facets lie inside the mesh; it "
                "needs boundary facets."
            )
        return pairs

    def owned_cells(self, name: str | None, wanted_by: str) -> Indices:
        """Owned cells of a named set, sorted; all if it has no name. Collective."""
        owned = self.mesh.topology.index_map(3).size_local
        if name is None:
            return np.arange(owned, dtype=np.int32)
        cells = self.domain.find(name, (3,), wanted_by).entities
        return np.sort(cells[cells < owned])

    def box_of(self, x: Array) -> tuple[Array, Array]:
        """Ends of the box of some places of all ranks, shapes (3,) [m]. Collective."""
        return box_of(self.comm, x)

    def sum(self, values: npt.ArrayLike) -> Any:
        """Sum of a number or an array over all ranks. Collective."""
        total = np.array(values, dtype=np.float64, order="C")  # objects take 20 times as long
        self.comm.Allreduce(MPI.IN_PLACE, total, op=MPI.SUM)
        return float(total) if total.ndim == 0 else total

    @property
    def centre_of_mass(self) -> Array:
        """Centre of mass in the reference configuration, shape (3,) [m]. Collective."""
        return self.centre_of(1.0, self.space.tabulate_dof_coordinates())

    def centre_of(self, members: Array | float, x: Array) -> Array:
        """Centre of mass of nodes at places x, members being 1 at these, else 0 [m]. Collective."""
        n = self.owned_nodes
        m = inertial_masses(self)[:, None] * np.broadcast_to(members, (len(x), 1))[:n]
        moment = np.asarray(self.sum((m * x[:n]).sum(axis=0)))
        for mass in (e for e in self.named(fx.PointMass) if e.is_carried):  # m has it in the middle
            place, every = mass.remote.place, np.broadcast_to(members, (len(x), 1))
            share = self.sum(place.weights @ every[place.nodes, 0])
            moment += share * float(mass.mass) * mass.remote.arm
        return moment / self.sum(m.sum())

    @cached_property
    def component(self) -> tuple[fem.FunctionSpace, Ints]:
        """The space of one component of `space`, and the local node of each of its local dofs.

        Collective, when it is first asked for.
        """
        space, dofs = self.space.sub(0).collapse()
        return space, np.reshape(dofs, -1) // 3

    @cached_property
    def parts(self) -> ConnectedParts:
        """Connected parts of the mesh, those that share no nodes. Collective."""
        return connected_parts(self.mesh, 0)

    @cached_property
    def stiff_parts(self) -> ConnectedParts | None:
        """Connected parts of cells stiffer than the softest by `MUCH`; None if none. Collective.

        The number of the part of other cells is -1.
        """
        bound = MUCH * min(material.stiffness for material, _ in self.materials)
        much = [(1.0, cells) for m, cells in self.materials if m.stiffness >= bound > 0.0]
        if not much:
            return None
        marks = self.cellwise(much)
        stiff = marks.x.array[marks.function_space.dofmap.list[:, 0]] > 0
        parts = connected_parts(self.mesh, 0, stiff)
        found = np.unique(np.concatenate(self.comm.allgather(np.unique(parts.of_cell[stiff]))))
        number = np.full(parts.count, -1)
        number[found] = np.arange(found.size)
        of_cell, of_entity = number[parts.of_cell], number[parts.of_entity]
        return ConnectedParts(
            found.size, of_cell, of_entity, parts.lower[found], parts.upper[found]
        )

    @property
    def mean_cell_size(self) -> float:
        """Cube root of the mean volume of a cell [m]. Collective."""
        own = self.nodal_mass - self.point_masses
        mass = self.sum(own[: self.owned_nodes].sum())
        return float(np.cbrt(mass / self.sum(sum(m.rho * c.size for m, c in self.materials))))

    def cell_weights(self, density: Any, cells: Indices) -> Array:
        """∫ density Nᵢ dV over owned cells, per local node with ghosts. Collective."""
        return nodal_weights(self.space, density, "dx", cells)

    def facet_weights(self, name: str, wanted_by: str, density: Any = 1.0) -> Array:
        """∫ density Nᵢ dA over a set's boundary facets, per local node with ghosts. Collective."""
        return nodal_weights(self.space, density, "ds", self.boundary(name, wanted_by))

    def density(self) -> fem.Function:
        """ρ0 per cell [kg/m³] as a piecewise constant function."""
        return self.cellwise([(m.rho, cells) for m, cells in self.materials])

    def cellwise(self, values: Sequence[tuple[float, Indices]]) -> fem.Function:
        """A piecewise constant function from values and the owned cells that have them."""
        f = fem.Function(self.cell_space)
        for value, cells in values:
            f.x.array[f.function_space.dofmap.list[cells, 0]] = value
        f.x.scatter_forward()
        return f

    def __repr__(self) -> str:
        """Size and number of effects, in a line."""
        return in_a_line(self)

    def _repr_html_(self) -> str:
        """Its description, in a notebook."""
        return as_text("\n".join(description(self, None, 0)))

    def describe(self, dt: float | None = None, periods: int | None = None) -> str:
        """Print, on rank 0, the content of the scene and when it acts. Collective.

        Args:
            dt: Time step [s], for the number of cells that a wave passes in it; one resolves waves.
            periods: How many of the longest `rigidfx.periods`; three where they are cheap if None.

        Returns:
            The text, on all ranks.
        """
        step = None if dt is None else positive("describe", "dt", dt)
        count = None if periods is None else whole("describe", "periods", periods, least=0)
        check_same(self.comm, "describe", {"dt": step, "periods": count})
        text = "\n".join(description(self, step, count))
        if self.comm.rank == 0:
            print(text, flush=True)  # noqa: T201 - it is what this is for
        return text

    @property
    def simplex(self) -> bool:
        """Whether cells are tetrahedra."""
        return bool(self.mesh.topology.cell_type == dmesh.CellType.tetrahedron)
