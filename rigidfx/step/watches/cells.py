"""Does anything turn too far in a step, or is a cell compressed so far that it may buckle?

A step turns a free part by 2 atan(ωΔt/2) whatever ω: 1 % too slow where ωΔt = 0.35, 7 % where it is
1. St.Venant and Kirchhoff's material has no stable state of strong compression: a cube of 4 × 4 × 4
cells between walls, ν = 0.3, loses its stability at a stretch of 0.65 with standard cells and of
0.70 with enhanced ones (lowest eigenvalues of `demos/benchmarks/known_answers.py`).
"""

from typing import Any, ClassVar

import basix
import dolfinx.mesh as dmesh
import numpy as np
from mpi4py import MPI

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.scene.scene import Scene
from rigidfx.step.watches.judge import Attempt, WarnsOnce

EVERY = 8  # steps: cells that are wrong are so for long, and a look costs what inversion's does
TOO_FAR = 1.0  # |θ|, where a free rotation is 7 % too slow
ONE_PER_CENT = 0.33  # |θ| where, also after Δt is rounded for a message, it is 1 % too slow
CORNERS = {"hexahedron": [0, 3, 5, 6], "tetrahedron": [0, 1, 2, 3]}  # a tetrahedron in each cell
LEAST = 0.75  # stretch that is warned of


class CellWatch(WarnsOnce):
    """Looks at flexible cells in every eighth accepted step; warns once."""

    remembered: ClassVar[Remembered] = WarnsOnce.remembered | same("_steps")

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        """Begin before the first step; u₀ and u₁ of the forces hold its ends. Collective."""
        super().__init__(scene.comm)
        self._mesh, self._forces = scene.mesh, forces
        self._X: Array = scene.space.tabulate_dof_coordinates()
        self._all = scene.space.dofmap.list
        self._steps = 0
        self.bind({})

    def bind(self, flexible: Cells) -> None:
        """Measure these cells from now on."""
        self._cells = np.concatenate([np.empty(0, np.int32), *flexible.values()])
        self._nodes = self._all[self._cells]

    def _due(self) -> bool:
        """Count a step; whether cells are looked at in it."""
        self._steps += 1
        return self.waits and self._steps % EVERY == 1

    def _most(self, values: Array, none: float) -> tuple[float, int | None]:
        """The largest value of all cells; its cell on a rank that has it. Collective."""
        k = int(np.argmax(values)) if values.size else -1
        own = none if k < 0 else float(values[k])
        most = self._comm.allreduce(own, op=MPI.MAX)
        return most, int(self._cells[k]) if k >= 0 and own == most else None

    def _name(self, cell: int | None) -> str:
        """Name of an owned cell of some ranks, in a message; the first of several. Collective."""
        mine: Any = None
        if cell is not None:
            number = int(self._mesh.topology.original_cell_index[cell])
            middle = dmesh.compute_midpoints(self._mesh, 3, np.array([cell], np.int32))[0]
            mine = number, middle.tolist()
        number, X = min(found for found in self._comm.allgather(mine) if found is not None)
        return f"cell {number} of the mesh around X = ({X[0]:.6g}, {X[1]:.6g}, {X[2]:.6g}) m"


class RotationPerStep(CellWatch):
    """Looks at rigid bodies in each accepted step, at flexible cells in some; warns once."""

    remembered: ClassVar[Remembered] = CellWatch.remembered

    def bind(self, flexible: Cells) -> None:
        """Measure these cells from now on."""
        super().bind(flexible)
        self._nodes = self._nodes[:, CORNERS[self._mesh.topology.cell_name()]].T

    def accept(self, attempt: Attempt) -> None:
        """Measure rotations of bodies, and in some steps of cells. Collective."""
        dt, increments, due = attempt.dt, attempt.increments, self._due()
        if not self.waits:
            return
        of_bodies = np.linalg.norm(increments.theta, axis=1)
        square, cell = self._most(self._squares(), 0.0) if due else (0.0, None)
        most = float(np.sqrt(square))
        angle = max(most, float(of_bodies.max(initial=0.0)))
        if angle <= TOO_FAR:
            return
        if angle > most:
            name = f"body '{increments.start.of.records[int(np.argmax(of_bodies))].name}'"
        else:
            name = self._name(cell)
        self.say(
            f"In the step from t = {attempt.t:.6g} s {name} turns at {angle / dt:.3g} rad/s: by "
            f"{angle:.3g} rad per step with Δt = {dt:.3g} s. A step turns by 2 atan(ωΔt/2) "
            f"instead, {2 * np.arctan(angle / 2):.3g} rad, and never by half a revolution. Energy "
            "and momenta are conserved all the same, but it lags behind the true motion. With "
            f"Δt ≤ {ONE_PER_CENT * dt / angle:.2g} s it turns 1 % too slowly at most."
        )

    def _squares(self) -> Array:
        """|θ|² of this rank's flexible cells."""
        u0, u1 = (f.x.array.reshape(-1, 3) for f in (self._forces.u0, self._forces.u1))
        theta = cell_rotations((self._X + u0)[self._nodes], (u1 - u0)[self._nodes])
        return np.asarray((theta * theta).sum(axis=0))


class Compression(CellWatch):
    """Looks at the least stretch in the middle of flexible hexahedra, in every eighth step."""

    remembered: ClassVar[Remembered] = CellWatch.remembered

    def bind(self, flexible: Cells) -> None:
        """Measure these cells from now on."""
        super().bind(flexible)
        brick = basix.create_element(basix.ElementFamily.P, basix.CellType.hexahedron, 1)
        slopes = brick.tabulate(1, np.full((1, 3), 0.5))[1:, 0, :, 0].T  # of shape functions
        J = np.einsum("cni,nk->cik", self._X[self._nodes], slopes)
        self._gradients = np.einsum("nk,ckj->cnj", slopes, np.linalg.inv(J))

    def accept(self, attempt: Attempt) -> None:
        """Measure stretches in every eighth step. Collective."""
        if not self._due():
            return
        u = self._forces.u1.x.array.reshape(-1, 3)[self._nodes]
        F = np.eye(3) + u.mT @ self._gradients
        square, cell = self._most(-np.linalg.eigvalsh(F.mT @ F)[:, 0], -1.0)
        least = float(np.sqrt(max(-square, 0.0)))
        if least >= LEAST:
            return
        self.say(
            f"In the step from t = {attempt.t:.6g} s {self._name(cell)} is compressed to "
            f"{least:.2g} of its length. Cells with element='enhanced' may form hourglasses there, "
            "below some 0.7, and standard ones of StVenantKirchhoff are not stable either below "
            "0.65. Take "
            "element='standard' and NeoHooke for strong compression."
        )


def cell_rotations(x0: Array, d: Array) -> Array:
    """Half the curl of d with respect to x₀ + ½ d: θ of d = θ × (x₀ + ½ d), shape (3, cells).

    Four nodes of each cell are at x₀ at the start of a step and move by d, (4, cells, 3) [m].
    """
    x = x0 + 0.5 * d
    y = np.ascontiguousarray((x[1:] - x[0]).transpose(0, 2, 1))
    e = np.ascontiguousarray((d[1:] - d[0]).transpose(0, 2, 1))
    # ∇d = Σ d_i ⊗ n_i/det for edges y_i and normals n_i of the faces between the other two.
    n = [_cross(y[1], y[2]), _cross(y[2], y[0]), _cross(y[0], y[1])]
    det = (y[0] * n[0]).sum(axis=0)
    curl = sum(_cross(a, b) for a, b in zip(n, e, strict=True))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(0.5 * curl / det, nan=0.0, posinf=0.0, neginf=0.0)


def _cross(a: Array, b: Array) -> Array:
    """a × b, shapes (3, n)."""
    return np.stack([
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ])  # fmt: skip
