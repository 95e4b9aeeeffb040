"""The energy-momentum method as one would write it in DOLFINx and petsc4py, without rigidfx."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

import rigidfx as rf
from rigidfx.base.compat import integration_facets

LU_BELOW = 50_000  # unknowns; beyond, a factorisation takes gigabytes and most of a minute
SOLVERS = {  # linear ones, by PETSc's options
    "gmres+ilu": {
        "ksp_type": "gmres",
        "pc_type": "ilu",
        "ksp_rtol": "1e-8",
        "ksp_max_it": "1000",  # more cost more than a direct solver
    },
    "lu": {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"},
}
Traction = Callable[[float], npt.ArrayLike]  # of time [s], three components [Pa]


@dataclass(frozen=True)
class PlainStep:
    """How often Newton's method and the linear solver went round in a step."""

    iterations: int
    linear_iterations: int


class PlainLoop:
    """One form with the inertia in it, default compiler options, an AIJ matrix, an SNES.

    On one rank, for one material of St.Venant and Kirchhoff. An iterator of its steps.

    Attributes:
        u0, v0: Displacements [m] and velocities [m/s] at the end of the last step.
        t: That time [s].
    """

    def __init__(
        self,
        problem: rf.Scene,
        dt: float,
        tractions: Mapping[str, Traction],
        solver: Mapping[str, str],
        held: str | None = None,
        floor: float = 1e-50,
    ) -> None:
        """Compile the form and set up an SNES.

        Tractions, by names of facets, are dead loads; facets `held` do not move. Newton's iteration
        ends at 1e-12 of the first residual, or at a floor [N].
        """
        self._problem, self._dt, self.t = problem, dt, 0.0
        mesh, V = problem.mesh, problem.space
        self.u0, self.u1, self.v0 = (fem.Function(V) for _ in range(3))
        self._tractions = tractions
        self._loads = {name: fem.Constant(mesh, np.zeros(3)) for name in tractions}
        self._held = self._support(held)
        R = self._residual_form()
        self.residual_form = fem.form(R)
        self.tangent_form = fem.form(ufl.derivative(R, self.u1, ufl.TrialFunction(V)))
        self.A = fem_petsc.create_matrix(self.tangent_form)
        self.x, self.b = self.A.createVecRight(), fem.Function(V)
        self.r = self.A.createVecLeft()
        self.snes = self._newton(solver, floor)

    def _support(self, held: str | None) -> list[fem.DirichletBC]:
        """The facets that do not move."""
        if held is None:
            return []
        V, facets = self._problem.space, self._problem.domain.find(held, (2,), "benchmark")
        return [fem.dirichletbc(
            np.zeros(3), fem.locate_dofs_topological(V, 2, facets.entities), V
        )]  # fmt: skip

    def _residual_form(self) -> ufl.Form:
        """R(u₁; w)."""
        problem, mesh = self._problem, self._problem.mesh
        [(material, _)] = problem.materials
        E, nu = material.E, material.nu
        w = ufl.TestFunction(problem.space)
        data = (E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu)), material.rho, self._dt)
        lmbda, mu, rho, dt = (fem.Constant(mesh, x) for x in data)
        identity = ufl.Identity(3)

        def stress(u: fem.Function) -> ufl.core.expr.Expr:
            F = identity + ufl.grad(u)
            strain = (F.T * F - identity) / 2
            return lmbda * ufl.tr(strain) * identity + 2 * mu * strain

        F = identity + ufl.grad((self.u0 + self.u1) / 2)
        S = (stress(self.u0) + stress(self.u1)) / 2
        dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": problem.quadrature_degree})
        of_mass = (
            {"quadrature_rule": "GLL", "quadrature_degree": 2 * problem.order - 1}
            if problem.mass == "lumped"
            else {"quadrature_degree": 2 * problem.order}
        )
        acceleration = 2 * (self.u1 - self.u0 - dt * self.v0) / dt**2
        R = rho * ufl.inner(acceleration, w) * ufl.dx(domain=mesh, metadata=of_mass)
        R += ufl.inner(F * S, ufl.grad(w)) * dx
        sets = [problem.domain.find(name, (2,), "benchmark") for name in self._loads]
        facets = [(k, integration_facets(mesh, s.entities)) for k, s in enumerate(sets)]
        ds = ufl.Measure("ds", domain=mesh, subdomain_data=facets)
        for k, load in enumerate(self._loads.values()):
            R -= ufl.inner(load, w) * ds(k)
        return R

    def _newton(self, solver: Mapping[str, str], floor: float) -> PETSc.SNES:
        """An SNES with some options."""
        snes = PETSc.SNES().create(self._problem.comm)
        snes.setOptionsPrefix("plain_")
        options = PETSc.Options("plain_")
        mine = {**solver, "snes_linesearch_type": "basic"}
        for name, value in mine.items():
            options[name] = value
        snes.setFunction(self._residual, self.r)
        snes.setJacobian(self._tangent, self.A)
        snes.setTolerances(rtol=1e-12, atol=floor, stol=0.0, max_it=25)
        snes.setFromOptions()
        for name in mine:
            options.delValue(name)
        return snes

    def _residual(self, snes: PETSc.SNES, x: PETSc.Vec, r: PETSc.Vec) -> None:
        """R(u₁)."""
        self.u1.x.array[: x.local_size] = x.array_r
        self.u1.x.scatter_forward()
        self.b.x.array[:] = 0.0
        fem.assemble_vector(self.b.x.array, self.residual_form)
        for support in self._held:
            held = support.dof_indices()[0]
            self.b.x.array[held] = self.u1.x.array[held]
        r.array[:] = self.b.x.array[: x.local_size]

    def _tangent(self, snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, B: PETSc.Mat) -> None:
        """dR/du₁."""
        A.zeroEntries()
        fem_petsc.assemble_matrix(A, self.tangent_form, bcs=self._held)
        A.assemble()

    def __iter__(self) -> Iterator[PlainStep]:
        return self

    def __next__(self) -> PlainStep:
        """Advance one step."""
        dt = self._dt
        for name, load in self._loads.items():
            load.value[:] = self._tractions[name](self.t + dt / 2)
        self.x.array[:] = self.u0.x.array + dt * self.v0.x.array
        self.snes.solve(None, self.x)
        if self.snes.getConvergedReason() <= 0:
            raise RuntimeError("the plain loop did not converge")
        self.v0.x.array[:] = 2 / dt * (self.x.array_r - self.u0.x.array) - self.v0.x.array
        self.u0.x.array[:] = self.x.array_r
        self.t += dt
        return PlainStep(self.snes.getIterationNumber(), self.snes.getLinearSolveIterations())
