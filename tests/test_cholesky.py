"""Cholesky's factors of a tangent's symmetric part: where they serve, and where they do not."""

from __future__ import annotations

import numpy as np
import pytest
from petsc4py import PETSc
from scipy.sparse import csr_array
from scipy.sparse import random as random_sparse
from test_kept_tangent import DT, SPIN, STEEL, keep

import rigidfx as rf
from rigidfx.step.linear.linear_solver import FORMER, OF_DEFINITE, has_cholmod, solver_of
from rigidfx.step.newton.factors import SKEW, Cholesky

N = 60


def entries(seed=1):
    """A symmetric and a skew matrix of the same pattern, of norm 1."""
    some = random_sparse(N, N, 0.1, random_state=seed).toarray()
    symmetric, skew = some + some.T + 20 * np.eye(N), some - some.T
    return symmetric / np.linalg.norm(symmetric), skew / np.linalg.norm(skew)


def matrix(values):
    """It, with zeros kept where the transposed matrix has entries."""
    full = csr_array((values != 0) | (values.T != 0) | np.eye(N, dtype=bool))
    rows = np.repeat(np.arange(N), np.diff(full.indptr))
    data = values[rows, full.indices]
    A = PETSc.Mat().createAIJ((N, N), csr=(full.indptr, full.indices, data), comm=PETSc.COMM_SELF)
    A.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, False)
    A.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
    return A


def solution(cholesky, A):
    """z = S⁻¹ (1, 2, …)."""
    r, z = A.createVecs()
    r.array[:] = np.arange(1, N + 1)
    cholesky.ksp.solve(r, z)
    return z.array


@pytest.mark.skipif(not has_cholmod(), reason="PETSc has no CHOLMOD")
def test_what_is_skew_or_not_definite_is_left_to_lu(capfd):
    symmetric, skew = entries()
    assert not Cholesky(matrix(symmetric + 2 * SKEW * skew)).renew()
    least = np.linalg.eigvalsh(symmetric)[0]
    indefinite = symmetric - 1.1 * least * np.eye(N)
    assert not Cholesky(matrix(indefinite)).renew()
    assert not Cholesky(matrix(np.nan * symmetric)).renew()
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(not has_cholmod(), reason="PETSc has no CHOLMOD")
def test_what_swings_has_cholesky_factors_and_what_turns_lu(monkeypatch):
    keep(monkeypatch)
    bar = rf.box((0, 0, 0), (1, 0.2, 0.2), (8, 2, 2))
    push = rf.Traction("x1", (0.0, 0.0, 1e6))  # Pa
    long = 10 * DT  # not well-conditioned: else PETSc's own LU would do
    for effect, kind in ((rf.Fixed("x0"), "cholesky"), (SPIN, "lu")):
        reports = rf.simulate(rf.Scene(bar, STEEL, [effect, push]), long, 10 * long)
        kept = [report.solver for report in reports if report.solver.startswith("kept")]
        assert kept[-1] == f"kept preonly+{kind}"


@pytest.mark.skipif(not has_cholmod(), reason="PETSc has no CHOLMOD")
def test_symmetric_matrices_have_them_as_well_and_mumps_what_is_not_definite():
    symmetric, _ = entries()
    least = np.linalg.eigvalsh(symmetric)[0]
    for S, by in ((symmetric, "cholmod"), (symmetric - 1.1 * least * np.eye(N), "mumps")):
        A = matrix(S)
        r, z = A.createVecs()
        r.array[:] = np.arange(1, N + 1)
        ksp = solver_of(A)
        ksp.solve(r, z)
        assert ksp.getOptionsPrefix() == OF_DEFINITE
        assert ksp.getPC().getFactorSolverType() == by
        assert z.array == pytest.approx(np.linalg.solve(S, r.array), rel=1e-8)
        ksp.destroy()


@pytest.mark.parametrize("prefix", [OF_DEFINITE, FORMER])
def test_options_of_definite_systems_count_under_the_former_prefix(prefix):
    symmetric, _ = entries()
    PETSc.Options(prefix)["ksp_type"] = "cg"
    try:
        ksp = solver_of(matrix(symmetric))
    finally:
        PETSc.Options(prefix).delValue("ksp_type")
    assert ksp.getType() == "cg"
    assert not PETSc.Options(OF_DEFINITE).getAll()
    ksp.destroy()
