"""The oracle of adaptive rigidification, asked along a run of ours.

A. Mercier-Aubin, A. Winter, D.I.W. Levin and P.G. Kry, Adaptive rigidification of elastic solids,
ACM Trans. Graph. 41 (2022) 71, let rigid cells become elastic where an approximate step of the
whole elastic system strains them faster than a threshold: from the present state, in which they
move rigidly, one iteration of conjugate gradients on the linear equations of a step, with M + h² L
as its preconditioner, L the Laplacian weighted with Young's modulus. Theirs is the incomplete
Cholesky factor of that with a drop tolerance of 1e-6, here it is the complete one; their step is
backward Euler, here it is ours.
"""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import SuperLU, splu

import rigidfx as rf
from rigidfx.preparation import prepare
from rigidfx.scene.timeline import Timeline

__all__ = ["Oracle", "judged_oracle"]


class Oracle:
    """Knows the fully flexible system of a scene; on one rank."""

    def __init__(self, scene: rf.Scene, dt: float) -> None:
        """Set the flexible system up.

        Args:
            scene: The problem.
            dt: Δt [s].
        """
        self._run, _ = prepare(scene, Timeline(dt, 1e9 * dt), rf.StrainRate(0.0, 1e9))
        self._dt, self._scene = dt, scene
        self._stiffness = _laplacian(scene)
        self._factor: tuple[object, SuperLU] | None = None

    def __enter__(self) -> Oracle:
        return self

    def __exit__(self, *_: object) -> None:
        self._run.stepper.close()

    def rates(self, report: rf.Report) -> np.ndarray:
        """Strain rate of each cell in the step after a report of ours, as they would guess [1/s].

        Args:
            report: The present one of our run.
        """
        stepper, dt, state = self._run.stepper, self._dt, self._run.stepper.state
        report.state.rebuild()
        state.place(report.state.u.x.array.copy())
        state.move(report.state.v.x.array.copy())
        state.t = report.t
        self._run.switch.follow_effects(dt)
        system = stepper.system
        equations, dofs = system.equilibrium, system.layout.rows.dofs
        stepper.forces.set_time(state.t + dt / 2, dt)
        system.actions.set_time(state.t + dt / 2, dt)
        v0, y = system.layout.rows.vector(), equations.prolongation.unknowns()
        v0.array[:] = state.v.x.array[dofs]
        imposed = stepper.prescribed.increments(state.t, state.t + dt)
        equations.begin(dt, v0, imposed, state.bodies)
        free = equations.prolongation.free
        y.array[:] = dt * v0.array_r[free]
        r, z, Az = y.duplicate(), y.duplicate(), y.duplicate()
        equations.residual(y, r)
        equations.tangent()
        z.array[:] = self._factors(dofs[free]).solve(-r.array_r)
        equations.tangent_matrix.mult(z, Az)
        curvature = z.dot(Az)
        y.axpy(-z.dot(r) / curvature if curvature > 0 else 0.0, z)
        equations.residual(y, r)
        assert stepper.indicator is not None
        stepper.indicator.measure(dt)
        for vector in (v0, y, r, z, Az):
            vector.destroy()
        return stepper.indicator.values.copy()

    def _factors(self, dofs: np.ndarray) -> SuperLU:
        """Factors of their preconditioner over free dofs."""
        system = self._run.stepper.system
        if self._factor is None or self._factor[0] is not system:
            mass = self._scene.nodal_mass[dofs // 3]
            P = self._stiffness[dofs][:, dofs] / 2 + diags_array(2 / self._dt**2 * mass)
            self._factor = system, splu(csc_array(P))
        return self._factor[1]


def _laplacian(scene: rf.Scene) -> csr_array:
    """∫ E ∇φ·∇ψ dV over the dofs, E Young's modulus [N/m]."""
    modulus = fem.Function(fem.functionspace(scene.mesh, ("DG", 0)))
    for material, cells in scene.materials:
        modulus.x.array[cells] = material.E
    u, v = ufl.TrialFunction(scene.space), ufl.TestFunction(scene.space)
    A = fem_petsc.assemble_matrix(fem.form(modulus * ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx))
    A.assemble()
    rows, columns, values = A.getValuesCSR()
    out = csr_array((values, columns, rows), shape=A.getSize())
    A.destroy()
    return out


def judged_oracle(
    rates: np.ndarray,
    rigid: np.ndarray,
    guesses: np.ndarray,
    threshold: float,
    tol: float,
    window: int,
) -> dict[str, float | int]:
    """What the oracle would have woken, found and missed, while our cells were rigid.

    Args:
        rates: Strain rates of the twin, shape (steps, cells) [1/s].
        rigid: Which cells were rigid at the end of each step.
        guesses: The oracle's strain rates of the same steps [1/s].
        threshold: Strain rate that wakes [1/s].
        tol: Tolerance [1/s].
        window: Steps of a window.

    Returns:
        oracle_needed: cells that we released and that strain at more than twice the threshold in
        the twin within a window; oracle_missed: the share of them for which it says nothing until
        they are released. oracle_woken: first steps above the threshold, of each cell in each time
        that it is rigid; oracle_false: the share of them that stays below tol in the twin for two
        windows.
    """
    steps, cells = rates.shape
    before = np.vstack([np.zeros((1, cells), dtype=bool), rigid[:-1]])
    above = before & (guesses > threshold)
    woken = false = needed = missed = 0
    for cell in np.flatnonzero(before.any(axis=0)):
        edges = np.flatnonzero(np.diff(np.r_[False, before[:, cell], False]))
        for first, end in edges.reshape(-1, 2):
            found = first + np.flatnonzero(above[first:end, cell])[:1]
            if found.size:
                woken += 1
                ahead = rates[found[0] : found[0] + 2 * window, cell]
                false += bool((ahead <= tol).all())
            if end < steps and (rates[end - 1 : end + window, cell] > 2 * threshold).any():
                needed += 1
                missed += not found.size
    return {
        "oracle_needed": needed,
        "oracle_missed": missed / max(needed, 1),
        "oracle_woken": woken,
        "oracle_false": false / max(woken, 1),
    }
