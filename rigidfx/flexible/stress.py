"""Cauchy stress and strain at the integration points of cells, and their means over cells.

    σ = F S Fᵀ / J,    S = 2 ∂W/∂C,  J = det F,      E = ½ (C - I)

A cell's mean stress is that over its deformed volume, ∫ F S Fᵀ dV0 / ∫ J dV0. It balances forces on
a cell, and is not what a bent part bears at its surface: of two second-order cells over the height
of a beam it is 0.47 of the bending peak. For peaks take `rigidfx.flexible.nodal_stress`.

Indices of a part with shapes have the strains that its energy is of: those of the frozen shape and
the first derivative along Φ q. Nodes of a rigid body follow it, F = R F_frozen, so that its cells
keep σ = R σ_frozen Rᵀ; the stress of the forces on them comes by a displacement of their own, see
`rigidfx.recovered_stress`. The stress is that of W at an instant, without damping, and not the mean
over a step by which the energy-momentum method balances forces.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import basix
import numpy as np
import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_coefficients

from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.base.errors import SceneError
from rigidfx.base.form_cache import compile_expression
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.flexible.elimination import library_of
from rigidfx.flexible.kernels import jit_options, material_classes
from rigidfx.mechanics.enhanced import Enhancement
from rigidfx.mechanics.rotation import nearest_rotations
from rigidfx.mechanics.schemes import second_piola_kirchhoff
from rigidfx.scene.scene import Scene

SYMMETRIC = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))  # components that are computed
PLACES = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])  # where each of all nine is among them
AT_ONCE = 1 << 14  # cells, so that what is in between does not take more memory than the result


class Enhancements:
    """The enhancement of a displacement as a function that expressions can read."""

    def __init__(self, u: fem.Function) -> None:
        self._u = u
        self._eta: fem.Function | None = None

    def readable(self, expression: Any) -> Any:
        """The expression with a function in the place of the enhancement. Collective."""
        of = [w for w in extract_coefficients(expression) if isinstance(w, Enhancement)]
        if not of:
            return expression
        if self._eta is None:
            self._law = of[0].law
            self._eta = fem.Function(self._law.function_space)
            options = jit_options()["cffi_extra_compile_args"]
            self._library, _ = library_of(self._law.function_space.mesh.comm, options)
        return ufl.replace(expression, {of[0]: self._eta})

    def update(self, cells: Indices) -> None:
        """Compute it for some local cells; nothing if no expression reads it."""
        if self._eta is None or not cells.size:
            return
        mesh, V = self._u.function_space.mesh, self._u.function_space
        dofs = self._law.function_space.dofmap.list[cells]
        x = mesh.geometry.x[cell_geometry_dofs(mesh)[cells]]
        u = self._u.x.array.reshape(-1, 3)[V.dofmap.list[cells]]
        law = self._law.x.array.reshape(-1, 6)[dofs[:, 0], :3]
        eta = np.empty((cells.size, dofs.shape[1], 6))
        ffi = self._library.ffi
        given = (ffi.from_buffer("double[]", np.ascontiguousarray(a)) for a in (x, u, law))
        self._library.lib.enhancements(cells.size, *given, ffi.from_buffer("double[]", eta))
        self._eta.x.array.reshape(-1, 6)[dofs] = eta


class Added(NamedTuple):
    """A small motion of a shape, which make all of a cell's strain, as in parts with shapes."""

    shape: fem.Function  # displacement that makes the shape [m]
    motion: fem.Function  # the motion in the frame of the shape, ghosts included [m]
    cells: Bools  # which owned cells have it; u only says how they are turned
    # Displacements of the shape whose strains of second order come on top, or are taken away [m]
    curves: Sequence[tuple[fem.Function, float]] = ()


class Recovered(NamedTuple):
    """Strains of some cells in place of a displacement, or besides it."""

    u: fem.Function  # displacement in them [m]
    cells: Bools  # which owned cells these are, shape (cells,)
    # In which of them it is the first derivative of a motion, and strains are to follow it as such:
    # a bend turns nodes, and by its second order would stretch a slender part
    linear: Bools
    # Further strains of cells; those have nothing else in place of a displacement
    added: Added | None = None


class PointStress:
    """Stress and strain at integration points. Its expressions are compiled once, at construction.

    Attributes:
        points: Places of the points in the reference cell, shape (points, 3).
        weights: Their weights, shape (points,).
        u: Displacement that they are of: to be set, ghosts included, before `evaluate`.
        recovered: Strains of some cells in place of u; None for none. To be set likewise.
    """

    def __init__(self, scene: Scene) -> None:
        """Compile the expressions. Collective."""
        self._mesh = scene.mesh
        cell = getattr(basix.CellType, scene.mesh.topology.cell_name())
        self.points, self.weights = basix.make_quadrature(cell, scene.quadrature_degree)
        self.u = fem.Function(scene.space)
        self.recovered: Recovered | None = None
        self._nodes, self._X = scene.space.dofmap.list, scene.space.tabulate_dof_coordinates()
        F = scene.element.deformation_gradient(self.u)
        C = scene.element.right_cauchy_green(self.u)
        E = (C - ufl.Identity(3)) / 2
        J, volume = ufl.det(F), abs(ufl.JacobianDeterminant(scene.mesh))
        self._class = np.zeros(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
        self._expressions = []
        self._enhanced = Enhancements(self.u)
        for k, of in enumerate(material_classes(scene)):
            tau = F * second_piola_kirchhoff(of.law.energy, C, of.law.parameters) * F.T
            stress = [tau[ij] / J for ij in SYMMETRIC]
            values = ufl.as_vector([*stress, *(E[ij] for ij in SYMMETRIC), J * volume, volume])
            values = self._enhanced.readable(values)
            compiled = compile_expression(scene.comm, values, self.points, jit_options())
            self._expressions.append(compiled)
            self._class[of.cells] = k

    def take(self, u: fem.Function, recovered: Recovered | None = None) -> None:
        """Set displacements; arguments as the attributes."""
        self.u.x.array[:] = u.x.array
        self.recovered = recovered

    def evaluate(self, cells: Indices) -> Array:
        """Values at the points of some owned cells, in any order, shape (cells, points, 14).

        Stress [Pa] and strain, six components each in the order xx, yy, zz, xy, yz, xz; J and 1,
        times the volume of the cell for that of the reference cell [m³].
        """
        if self.recovered is None:
            return self._evaluated(cells)
        added = self.recovered.added
        besides = np.zeros(cells.size, dtype=bool) if added is None else added.cells[cells]
        linear = self.recovered.linear[cells] & ~besides
        moved = self.recovered.cells[cells] & ~linear & ~besides
        out = np.empty((cells.size, self.weights.size, 14))
        out[~moved] = self._evaluated(cells[~moved])
        out[moved] = self._displaced(cells[moved], 1.0)
        if linear.any():
            ends = (self._displaced(cells[linear], side)[:, :, :12] for side in (1.0, -1.0))
            out[linear, :, :12] += np.subtract(*ends) / 2
        if added is not None and besides.any():
            out[besides, :, :12] = self._shaped(cells[besides], added)
        return out

    def _shaped(self, cells: Indices, added: Added) -> Array:
        """Stress and strain of a shape and of a small motion of it, linear and turned with cells.

        Strains are those in the axes of the undeformed body, the same in any frame.
        """
        nodes = np.unique(self._nodes[cells])
        u, shape, motion = (f.x.array.reshape(-1, 3) for f in (self.u, added.shape, added.motion))
        kept, own = u[nodes], self._nodes[cells]
        before, out = (self._X + shape)[own], np.zeros((cells.size, self.weights.size, 12))
        terms = [(motion, 1.0, 0.5), (motion, -1.0, -0.5)]
        for curve, sign in added.curves:
            terms += [(curve.x.array.reshape(-1, 3), side, sign / 2) for side in (1.0, -1.0)]
        for field, side, weight in (*terms, (motion, 0.0, 1.0 - sum(w for *_, w in terms))):
            u[nodes] = shape[nodes] + side * field[nodes]
            values = self._evaluated(cells)[:, :, :12]
            if side:
                values = _turned(values, _rotations((self._X + u)[own], before))
            out += weight * values
        u[nodes] = kept
        return _turned(out, _rotations(before, (self._X + u)[own]))

    def _displaced(self, cells: Indices, side: float) -> Array:
        assert self.recovered is not None
        # Indices of both kinds share nodes. So these have the other displacement for a moment only.
        nodes = np.unique(self._nodes[cells])
        u, instead = (f.x.array.reshape(-1, 3) for f in (self.u, self.recovered.u))
        kept = u[nodes]
        u[nodes] += side * (instead[nodes] - kept)
        out = self._evaluated(cells)
        u[nodes] = kept
        return out

    def _evaluated(self, cells: Indices) -> Array:
        self._enhanced.update(cells)
        out = np.empty((cells.size, self.weights.size, 14))
        for k, expression in enumerate(self._expressions):
            own = np.flatnonzero(self._class[cells] == k)
            if own.size:
                values = expression.eval(self._mesh, cells[own])
                out[own] = np.asarray(values).reshape(own.size, *out.shape[1:])
        return out


class CauchyStress:
    """Measures the mean stress of all cells.

    Attributes:
        mesh: Theirs.
    """

    def __init__(self, scene: Scene, points: PointStress | None = None) -> None:
        """Compile the expressions, if they are not given. Collective.

        Args:
            scene: The problem.
            points: Stress at the integration points of that scene.

        Raises:
            SceneError: If the scene is none.
        """
        if not isinstance(scene, Scene):
            raise SceneError(f"CauchyStress: scene must be a Scene, got {type(scene).__name__}.")
        self.mesh = scene.mesh
        self._points = PointStress(scene) if points is None else points
        self._owned = int(scene.mesh.topology.index_map(3).size_local)

    def measure(self, u: fem.Function, recovered: Recovered | None = None) -> Array:
        """Mean Cauchy stress of each owned cell, shape (cells, 3, 3) [Pa].

        Args:
            u: Displacement, up to date inside bodies too: see `State.rebuild`.
            recovered: Strains of some cells in place of u, see `PointStress`.
        """
        self._points.take(u, recovered)
        out = np.empty((self._owned, 6))
        for cells in chunks(self._owned):
            values = self._points.evaluate(cells)
            parts = values[:, :, 12] * self._points.weights
            out[cells] = np.einsum("cq,cqi->ci", parts, values[:, :, :6]) / parts.sum(1)[:, None]
        return tensors(out)


def _rotations(a: Array, b: Array) -> Array:
    """Best rotation of each cell from places a of its nodes to places b, shape (cells, 3, 3)."""
    a, b = (x - x.mean(axis=1, keepdims=True) for x in (a, b))
    return nearest_rotations(np.einsum("cni,cnj->cij", b, a))


def _turned(values: Array, R: Array) -> Array:
    """Stress and strain of cells, the stress turned by R, shape (cells, points, 12)."""
    stress = np.einsum("cik,cqkl,cjl->cqij", R, tensors(values[:, :, :6]), R)
    i, j = np.transpose(SYMMETRIC)
    return np.concatenate([stress[:, :, i, j], values[:, :, 6:]], axis=2)


def chunks(cells: int) -> Iterator[Indices]:
    """The numbers below one, some at a time."""
    for first in range(0, cells, AT_ONCE):
        yield np.arange(first, min(first + AT_ONCE, cells), dtype=np.int32)


def tensors(components: Array) -> Array:
    """Symmetric tensors, shape (..., 3, 3), of their six components xx, yy, zz, xy, yz, xz."""
    return np.asarray(components[..., PLACES])


def von_mises(stress: Array) -> Array:
    """Von Mises' equivalent stress √(3/2 s:s), s the deviator, shape (...) [Pa].

    Args:
        stress: Cauchy stress, shape (..., 3, 3) [Pa].
    """
    pressure = np.trace(stress, axis1=-2, axis2=-1) / 3
    deviator = stress - pressure[..., None, None] * np.eye(3)
    return np.asarray(np.sqrt(1.5 * np.einsum("...ij,...ij->...", deviator, deviator)))
