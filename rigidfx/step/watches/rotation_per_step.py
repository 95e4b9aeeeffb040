"""Does anything turn too far in one step?

A step knows a rotation by its Cayley vector θ, x₁ - x₀ = θ × (x₀ + x₁)/2, and |θ| = ω Δt of a free
part, so that it turns by 2 atan(ω Δt/2) whatever ω: 1 % too slow where ω Δt = 0.35, 7 % where it is
1, and by less than half a revolution always. All balances hold; the motion is wrong.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.scene.scene import Scene
from rigidfx.step.watches.judge import Attempt, WarnsOnce, name_of_cell

WORTH_A_WARNING = 1.0  # |θ|, where a free rotation is 7 % too slow
ONE_PER_CENT = 0.33  # |θ| where, also after Δt is rounded for a message, it is 1 % too slow
EVERY = 8  # steps: cells that turn too far do so for long, and a look costs what inversion's does
CORNERS = {"hexahedron": [0, 3, 5, 6], "tetrahedron": [0, 1, 2, 3]}  # a tetrahedron in each cell


class RotationPerStep(WarnsOnce):
    """Looks at rigid bodies in each accepted step, at flexible cells in some; warns once."""

    remembered: ClassVar[Remembered] = WarnsOnce.remembered | same("_steps")

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        """Begin before the first step. Collective.

        Args:
            scene: The problem.
            forces: Internal forces, whose u₀ and u₁ hold start and end of a step.
        """
        super().__init__(scene.comm)
        self._mesh, self._forces = scene.mesh, forces
        self._X: Array = scene.space.tabulate_dof_coordinates()
        self._corners = scene.space.dofmap.list[:, CORNERS[scene.mesh.topology.cell_name()]].T
        self._steps = 0
        self.bind({})

    def bind(self, flexible: Cells) -> None:
        """Measure these cells from now on."""
        self._cells = np.concatenate([np.empty(0, np.int32), *flexible.values()])
        self._nodes = self._corners[:, self._cells]

    def accept(self, attempt: Attempt) -> None:
        """Measure rotations of bodies, and in some steps of cells. Collective."""
        dt, increments = attempt.dt, attempt.increments
        self._steps += 1
        if not self.waits:
            return
        of_bodies = np.linalg.norm(increments.theta, axis=1)
        turned, cell, most = 0.0, -1, 0.0
        if self._steps % EVERY == 1:
            turned, cell = self._cell()
            most = self._comm.allreduce(turned, op=MPI.MAX)
        angle = max(most, float(of_bodies.max(initial=0.0)))
        if angle <= WORTH_A_WARNING:
            return
        if angle > most:
            name = f"body '{increments.start.of.records[int(np.argmax(of_bodies))].name}'"
        else:
            name = name_of_cell(self._comm, self._mesh, cell if turned == most else None)
        self.say(
            f"In the step from t = {attempt.t:.6g} s {name} turns at {angle / dt:.3g} rad/s: by "
            f"{angle:.3g} rad per step with Δt = {dt:.3g} s. A step turns by 2 atan(ωΔt/2) "
            f"instead, {2 * np.arctan(angle / 2):.3g} rad, and never by half a revolution. Energy "
            "and momenta are conserved all the same, but it lags behind the true motion. With "
            f"Δt ≤ {ONE_PER_CENT * dt / angle:.2g} s it turns 1 % too slowly at most.",
        )

    def _cell(self) -> tuple[float, int]:
        """Largest |θ| of this rank's flexible cells, and which has it; 0 if there are none."""
        if not self._cells.size:
            return 0.0, -1
        u0, u1 = (f.x.array.reshape(-1, 3) for f in (self._forces.u0, self._forces.u1))
        x0 = (self._X + u0)[self._nodes]
        theta = cell_rotations(x0, (u1 - u0)[self._nodes])
        square = (theta * theta).sum(axis=0)
        k = int(np.argmax(square))
        return float(np.sqrt(square[k])), int(self._cells[k])


def cell_rotations(x0: Array, d: Array) -> Array:
    """Half the curl of d with respect to x₀ + ½ d: θ of d = θ × (x₀ + ½ d), shape (3, cells).

    Args:
        x0: Positions of four nodes of each cell at the start of a step, shape (4, cells, 3) [m].
        d: Their increments, likewise [m].
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
