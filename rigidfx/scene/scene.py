"""The whole problem, immutable and validated: mesh, materials, effects, discretisation.

What can be known to be wrong without a run is raised when a scene is made, the rest before the
first step, as it takes bodies and supports together in time; on all ranks alike.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import combinations
from math import isfinite
from types import MappingProxyType
from typing import Any, Literal

import dolfinx.mesh as dmesh
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la
from mpi4py import MPI

from rigidfx import effects as fx
from rigidfx.base import compat
from rigidfx.base.errors import SceneError, agree, together
from rigidfx.base.warning import warn
from rigidfx.domain.domain import Domain
from rigidfx.mechanics.materials import Material
from rigidfx.mechanics.schemes import EnergyMomentum, Scheme
from rigidfx.scene.assignment import assign
from rigidfx.scene.conflicts import check_together, overlap
from rigidfx.scene.mesh_checks import (
    parts_in_words,
    warn_of_bending,
    warn_of_distance,
    warn_of_gaps,
)
from rigidfx.scene.summary import effects_table, in_words, phases

__all__ = ["Scene"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int32]

# Points per cell of the one quadrature rule that W, H and the residual share, by polynomial degree.
STIFFNESS_DEGREE = {1: 2, 2: 4}
NEARLY_INCOMPRESSIBLE = 0.49  # ν above which first-order cells are warned of


class Scene:
    """A problem of structural dynamics.

    Attributes:
        domain: Mesh and names.
        materials: Pairs of a material and its owned cells; together they cover the mesh.
        effects: All effects as given.
        order: Order of the Lagrange displacement.
        mass: "lumped" (diagonal, default) or "consistent".
        scheme: Time integration scheme.
        space: Vector-valued function space of displacement and velocity.
        nodal_mass: ∫ ρ0 Nᵢ dV and point masses [kg] per local node, ghosts included, shape
            (nodes,).
        point_masses: The point masses in it [kg].
        supports: Pairs of a support and its local nodes, ghosts included.
        probes: Named points [m] whose histories are recorded.
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
        probes: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        """Validate the problem. Collective.

        Args:
            domain: Mesh and names.
            material: One material, or one for each of the named cell sets that make up the mesh.
            effects: What acts, in any order.
            order: 1 or 2. Sound with lumped mass: hexahedra of both orders (their nodal masses
                are those of a Gauss-Lobatto rule, which keeps the order) and tetrahedra of order
                1. Tetrahedra of order 2 have negative lumped masses at their vertices and need
                the consistent matrix.
            mass: "lumped" or "consistent", for the whole run.
            scheme: EnergyMomentum() if None; Midpoint() or Trapezoidal() otherwise.
            probes: Name → reference point [m].

        Raises:
            SceneError: If anything in it is unknown, impossible or in conflict.
        """
        if not isinstance(domain, Domain):
            raise SceneError(
                f"Scene: domain must be a Domain (box, from_arrays, read_msh, or Domain(mesh) of a "
                f"DOLFINx mesh), got {type(domain).__name__}."
            )
        self.domain = domain
        if isinstance(effects, str) or not isinstance(effects, Iterable):
            raise SceneError(f"Scene: effects must be a list of effects, got {effects!r}.")
        self.effects = tuple(effects)
        self.order, self.mass = order, mass
        self.scheme: Scheme = EnergyMomentum() if scheme is None else scheme
        if isinstance(scheme, type) or not hasattr(self.scheme, "virtual_work"):
            raise SceneError(
                f"Scene: scheme must be EnergyMomentum(), Midpoint() or Trapezoidal(), got "
                f"{scheme!r}."
            )
        self.probes = MappingProxyType(_points(probes or {}))
        self._check_discretisation()
        check_together(self.effects, self.scheme)
        self.materials = assign(domain, material)
        self._warn_of_locking()
        self.space = fem.functionspace(domain.mesh, ("Lagrange", order, (3,)))
        self.point_masses = self._point_masses()
        self.nodal_mass = self._nodal_mass()
        self.supports = self._supports()
        self._check_names()
        warn_of_gaps(domain, self.effects)
        warn_of_distance(domain)

    # What is asked of a scene -------------------------------------------------------------------

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

        In first-order tetrahedra the strain is constant, and so is all that depends on it: one
        point gives what four do.
        """
        return 1 if self._simplex and self.order == 1 else STIFFNESS_DEGREE[self.order]

    def named(self, kind: type[fx.Effect]) -> tuple[Any, ...]:
        """The effects of a kind, in the order given."""
        return tuple(e for e in self.effects if isinstance(e, kind))

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Sorted instants at which steps must end [s]."""
        return tuple(sorted({t for e in self.named(fx.Windowed) for t in e.breakpoints}))

    def acting(self, t: float, resolution: float) -> tuple[fx.Windowed, ...]:
        """The effects with a time window that act in a step that begins at t.

        Args:
            t: Time [s].
            resolution: Times closer than this are the same [s].
        """
        now = t + resolution
        return tuple(e for e in self.named(fx.Windowed) if e.since <= now < e.until)

    def nodes(self, name: str, wanted_by: str, dims: Sequence[int] = (2, 3, 1, 0)) -> Nodes:
        """Local nodes in the closure of a named set, ghosts included. Collective."""
        found = self.domain.find(name, dims, wanted_by)
        self.mesh.topology.create_connectivity(found.dim, 3)
        dofs = fem.locate_dofs_topological(self.space, found.dim, found.entities, remote=True)
        return np.sort(dofs).astype(np.int32)

    def shares(self, name: str, wanted_by: str) -> Array:
        """Equal parts of 1 for the nodes of a named set, per local node with ghosts. Collective."""
        parts = np.zeros(self.space.tabulate_dof_coordinates().shape[0])
        parts[self.nodes(name, wanted_by)] = 1.0
        return parts / self.sum(parts[: self.owned_nodes].sum())

    def boundary(self, name: str, wanted_by: str) -> Nodes:
        """Owned cell and local number of each facet of a named set, shape (n, 2). Collective.

        Raises:
            SceneError: If the set is unknown, or has facets that lie inside the mesh.
        """
        found = self.domain.find(name, (2,), wanted_by)
        pairs = compat.integration_facets(self.mesh, found.entities).reshape(-1, 2)
        inner = self.domain.count(found) - self.sum(len(pairs))
        if inner > 0:
            raise SceneError(
                f"{wanted_by} on '{name}': {int(inner)} of its facets lie inside the mesh; it "
                "needs boundary facets."
            )
        return pairs

    def owned_cells(self, name: str | None, wanted_by: str) -> Nodes:
        """Owned cells of a named set, sorted; all if it has no name. Collective."""
        owned = self.mesh.topology.index_map(3).size_local
        if name is None:
            return np.arange(owned, dtype=np.int32)
        cells = self.domain.find(name, (3,), wanted_by).entities
        return np.sort(cells[cells < owned])

    def sum(self, values: npt.ArrayLike) -> Any:
        """Sum of a number or an array over all ranks. Collective."""
        array = np.asarray(values, dtype=np.float64)
        total = self.comm.allreduce(array, op=MPI.SUM) if self.comm.size > 1 else array
        return float(total) if array.ndim == 0 else total

    @property
    def centre_of_mass(self) -> Array:
        """Centre of mass in the reference configuration, shape (3,) [m]. Collective."""
        n = self.owned_nodes
        m, X = self.nodal_mass[:n], self.space.tabulate_dof_coordinates()[:n]
        return np.asarray(self.sum(m @ X)) / self.sum(m.sum())

    @property
    def mean_cell_size(self) -> float:
        """Cube root of the mean volume of a cell [m]. Collective."""
        own = self.nodal_mass - self.point_masses
        mass = self.sum(own[: self.owned_nodes].sum())
        return float(np.cbrt(mass / self.sum(sum(m.rho * c.size for m, c in self.materials))))

    def nodal_weights(self, density: Any, measure: ufl.Measure) -> Array:
        """∫ density Nᵢ over a measure, per local node with ghosts, shape (nodes,). Collective."""
        test = ufl.TestFunction(self.space)
        form = fem.form(density * ufl.dot(ufl.as_vector((1.0, 0.0, 0.0)), test) * measure)
        out = fem.Function(self.space)
        fem.assemble_vector(out.x.array, form)
        out.x.scatter_reverse(la.InsertMode.add)
        out.x.scatter_forward()
        return out.x.array[::3].copy()

    def density(self) -> fem.Function:
        """ρ0 per cell [kg/m³] as a piecewise constant function."""
        return self.cellwise([(m.rho, cells) for m, cells in self.materials])

    def cellwise(self, values: Sequence[tuple[float, Nodes]]) -> fem.Function:
        """A piecewise constant function from values and the owned cells that have them."""
        f = fem.Function(fem.functionspace(self.mesh, ("DG", 0)))
        for value, cells in values:
            f.x.array[f.function_space.dofmap.list[cells, 0]] = value
        f.x.scatter_forward()
        return f

    def describe(self) -> str:
        """Print, on rank 0, what there is in the scene and when it acts. Collective.

        An effect that is not listed adds no term to the equations; one whose time window is closed
        has none any more.

        Returns:
            The text, on all ranks.
        """
        cells = self.mesh.topology.index_map(3).size_global
        nodes = self.space.dofmap.index_map.size_global
        kind = "tetrahedra" if self._simplex else "hexahedra"
        lines = [
            f"Scene of {cells} {kind} of order {self.order}, {nodes} nodes; {self.mass} mass; "
            f"{type(self.scheme).__name__}",
            *(
                f"  {line}, which shares no node with others"
                for line in parts_in_words(self.domain)
            ),
            "Materials",
            *(
                f"  {in_words(material)}; {int(self.sum(own.size))} cells"
                for material, own in self.materials
            ),
            "Effects" if self.effects else "Effects: none",
            *(f"  {line}" for line in effects_table(self.effects)),
        ]
        if self.named(fx.Windowed) or self.named(fx.Spring):
            lines += ["Acting", *(f"  {line}" for line in phases(self.effects))]
        text = "\n".join(lines)
        if self.comm.rank == 0:
            print(text, flush=True)  # noqa: T201 - it is what this is for
        return text

    @property
    def _simplex(self) -> bool:
        return bool(self.mesh.topology.cell_type == dmesh.CellType.tetrahedron)

    # Checks -------------------------------------------------------------------------------------

    def _check_discretisation(self) -> None:
        if not isinstance(self.order, (int, np.integer)) or self.order not in STIFFNESS_DEGREE:
            raise SceneError(f"Scene: order must be 1 or 2, got {self.order!r}.")
        if self.mass not in ("lumped", "consistent"):
            raise SceneError(f"Scene: mass must be 'lumped' or 'consistent', got {self.mass!r}.")
        if self._simplex and self.order == 2 and self.mass == "lumped":
            raise SceneError(
                "Scene: second-order tetrahedra have negative lumped masses at their vertices. "
                "Take mass='consistent', or order=1, or hexahedra."
            )
        curved = compat.coordinate_map(self.mesh).degree
        if curved > self.order:
            raise SceneError(
                f"Scene: cells of geometry order {curved} need at least "
                f"that order of displacement (got {self.order}), or a rigid rotation would "
                "strain them."
            )

    def _point_masses(self) -> Array:
        total = np.zeros(self.space.tabulate_dof_coordinates().shape[0])
        for point in self.named(fx.PointMass):
            total += point.mass * self.shares(point.where, "PointMass")
        return total

    def _warn_of_locking(self) -> None:
        nu = max((getattr(m, "nu", 0.0) for m, _ in self.materials), default=0.0)
        if self.order == 1 and nu > NEARLY_INCOMPRESSIBLE:
            warn(
                self.comm,
                f"Scene: first-order cells lock at ν = {nu:g}: they keep their volume at the price "
                "of hardly bending at all. Take order=2, or a smaller ν.",
            )
        if self.order == 1 and not any(r.where is None for r in self.named(fx.Rigid)):
            warn_of_bending(self.domain)

    def _nodal_mass(self) -> Array:
        # Two degrees above the integrand of an affine cell, for cells that are not.
        measure = ufl.dx(domain=self.mesh, metadata={"quadrature_degree": 2 * self.order + 2})
        mass = self.nodal_weights(self.density(), measure) + self.point_masses
        self._check_sums(mass)
        if self.mass == "lumped":
            worst = mass.min(initial=np.inf)
            agree(
                self.comm,
                None
                if worst > 0
                else f"Scene: a node has the lumped mass {worst:.3g} kg ≤ 0 (strongly curved "
                "cells?). Take mass='consistent'.",
            )
        return mass

    def _check_sums(self, mass: Array) -> None:
        """Refuse nodal masses that overflow in sums or in moments of inertia. Collective."""
        n = self.owned_nodes
        with np.errstate(over="ignore", invalid="ignore"):
            arms = (self.space.tabulate_dof_coordinates()[:n] ** 2).sum(axis=1)
            m, J = self.sum([mass[:n].sum(), mass[:n] @ arms])
        if not (np.isfinite(m) and np.isfinite(J)):
            raise SceneError(
                f"Scene: the masses of the nodes add up to {m:.3g} kg, with a moment of inertia "
                f"of {J:.3g} kg m² about the origin: too large for the arithmetic. Check the "
                "densities, the PointMass effects and the units."
            )

    def _supports(self) -> tuple[tuple[fx.Support, Nodes], ...]:
        supports = tuple((s, self.nodes(s.where, type(s).__name__)) for s in self.named(fx.Support))
        for (a, nodes_a), (b, nodes_b) in combinations(supports, 2):
            shared = np.intersect1d(nodes_a, nodes_b).size
            axes = set(a.axes) & set(b.axes)
            clash = bool(axes) and overlap(a, b) and not a.same_motion(b)
            if clash and self.sum(shared) > 0:
                raise SceneError(
                    f"Scene: {type(a).__name__} on '{a.where}' and {type(b).__name__} on "
                    f"'{b.where}' prescribe different motions of the same nodes at the same "
                    "time. Separate their sets, components or time windows."
                )
        for support, _ in supports:
            start = support.since if isfinite(support.since) else 0.0
            owner = f"{type(support).__name__} on '{support.where}'"
            self._ask(owner, start, partial(support.displacement_at, start))
            self._ask(owner, start, partial(support.velocity_at, start, 1.0))
            if isinstance(support, fx.PrescribedMotion):
                together(self.comm, f"{owner}: its path or velocity", partial(_agrees, support))
        return supports

    def _ask(self, owner: str, t: float, function: Callable[[], Array]) -> None:
        """Check that a user's function gives three finite numbers at time t. Collective."""

        def check() -> None:
            value = function()
            if np.shape(value) != (3,) or not np.isfinite(value).all():
                raise SceneError(
                    f"{owner}: at t = {t:g} s three finite components are expected, got {value}."
                )

        together(self.comm, f"{owner}: its function of time", check)

    def _check_names(self) -> None:
        for pressure in self.named(fx.Pressure):
            self.boundary(pressure.where, "Pressure")
            together(
                self.comm,
                f"Pressure on '{pressure.where}': its value or time function",
                partial(pressure.intensity, max(0.0, pressure.since)),
            )
        for spring in self.named(fx.Spring):
            self.nodes(spring.where, "Spring")
        for viscous in self.named(fx.KelvinVoigt):
            self.owned_cells(viscous.where, "KelvinVoigt")
        for resultant in self.named(fx.Resultant):
            start = max(0.0, resultant.since)
            owner = f"Resultant on '{resultant.body}'"
            self._ask(owner, start, partial(resultant.force_at, start))
            self._ask(owner, start, partial(resultant.torque_at, start))
        loads = [*self.named(fx.DeadLoad), *(q for p in self.named(fx.Preload) for q in p.loads)]
        for load in loads:
            where = getattr(load, "where", None)
            dims = {fx.Traction: (2,), fx.NodalForce: (2, 3, 1, 0)}.get(type(load), (3,))
            if where is not None:
                self.domain.find(where, dims, type(load).__name__)
            start = max(0.0, load.since)
            self._ask(
                f"{type(load).__name__} on '{where or 'all cells'}'",
                start,
                partial(load.intensity, start),
            )


def _agrees(support: fx.PrescribedMotion) -> None:
    """Refuse a velocity that contradicts its path at the start, or at a kink."""
    times = sorted({max(0.0, support.since), *(t for t in support.breakpoints if t > 0)})
    for t in times:
        wrong = support.contradiction(t) if t < support.until else ""
        if wrong:
            raise SceneError(
                f"PrescribedMotion on '{support.where}': {wrong}. Give the path's derivative, or "
                "no velocity at all."
            )


def _points(probes: Mapping[str, Sequence[float]]) -> dict[str, Array]:
    try:
        points = {name: np.asarray(p, dtype=np.float64) for name, p in probes.items()}
    except (AttributeError, TypeError, ValueError):
        raise SceneError(
            f"Scene: probes must be a dict of names to three numbers each, got {probes!r}."
        ) from None
    for name, point in points.items():
        if point.shape != (3,) or not np.isfinite(point).all():
            raise SceneError(f"Scene: probe '{name}' must be three finite numbers, got {point}.")
    return points
