"""Lowest eigenpairs of K φ = λ M φ, by SLEPc on all ranks; all pairs of small systems by LAPACK.

Krylov-Schur iterations (G. W. Stewart, SIAM J. Matrix Anal. Appl. 23 (2002) 601,
doi:10.1137/S0895479800371529) take the inverse of K + σM; K may be singular or indefinite. Known
motions without energy are kept out of the iteration, where rounding along them would grow by λ/σ. A
second iteration, orthogonal to all that has been found, looks for eigenvalues that the first one,
from one vector, has missed. A Ritz step ends it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import eigh

from rigidfx.base.errors import SceneError
from rigidfx.base.matrices import free
from rigidfx.base.types import Array, Bools, Ints
from rigidfx.linear.linear_solver import CHOLMOD, PREFIX, default_options, has_cholmod

MOST = 1000  # restarts of the iteration
OWN = PREFIX + "modes_"  # prefix of the options of the solver with K + σM


def check_installed() -> Any:
    """The module SLEPc; a `SceneError` if it is not installed."""
    try:
        from slepc4py import SLEPc
    except ImportError as error:
        raise SceneError(
            "modes: SLEPc's Python package slepc4py is not installed. Debian has it as "
            "python3-slepc4py-real, conda-forge as slepc4py."
        ) from error
    return SLEPc


def eigensolver(
    K: PETSc.Mat,
    M: PETSc.Mat,
    shift: float | None,
    count: int,
    tolerance: float,
    definite: bool = True,
) -> Any:
    """An EPS object of SLEPc for K φ = λ M φ; the caller destroys it. Collective.

    LAPACK finds all pairs at once without a shift σ [1/s²]. The count of pairs sizes the space of
    the iteration; a pair has converged at a relative tolerance. K + σM may be definite.
    """
    slepc = check_installed()
    eps = slepc.EPS().create(K.comm)
    eps.setOperators(K, M)
    eps.setProblemType(slepc.EPS.ProblemType.GHEP)
    if shift is None:
        eps.setType(slepc.EPS.Type.LAPACK)
        eps.setWhichEigenpairs(slepc.EPS.Which.SMALLEST_REAL)
        return eps
    eps.setType(slepc.EPS.Type.KRYLOVSCHUR)
    eps.setTarget(-shift)
    eps.setWhichEigenpairs(slepc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTolerances(tolerance, MOST)
    eps.setPurify(False)  # the Ritz step does more
    eps.getST().setType(slepc.ST.Type.SINVERT)
    ksp = eps.getST().getKSP()
    ksp.setOptionsPrefix(OWN)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
    ksp.getPC().setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
    if definite and K.comm.size == 1 and has_cholmod():
        ksp.getPC().setFactorSolverType(PETSc.Mat.SolverType.CHOLMOD)
        eps.setDimensions(count)
        try:
            with default_options(OWN, **CHOLMOD):
                eps.setUp()
        except PETSc.Error:  # it is not
            eps.destroy()
            return eigensolver(K, M, shift, count, tolerance, definite=False)
    return eps


class _NotFound(SceneError, np.linalg.LinAlgError):
    """An error of linear algebra, as it is to those who can do without eigenpairs."""


@dataclass(frozen=True)
class EigenControl:
    """Limits of the search for eigenpairs."""

    # Relative residual at which an eigenpair has converged. Equal modes are aligned by differences
    # of some hundredths, which divide it in the shapes.
    tolerance: float = 1e-12
    dense: int = 300  # unknowns up to which LAPACK finds all pairs at once, on each rank
    shift: float = 1e-8  # first σ, over the largest ratio of the diagonals of K and M
    # Largest σ over the lowest nonzero |λ|; above, the shift is set anew. Eigenvalues far below the
    # shift lie too close together for the iteration. Up to 1.6e4, 24 values of a plate in springs
    # and 12 of slender bars were as exact as with a shift below all.
    high: float = 1e4
    # Relative distance of two λ up to which they are one cluster, which is never cut
    gap: float = 1e-3
    # An eigenvalue is zero below this factor × φ·diag(K)φ/φ·Mφ. Rounding in the assembly of K
    # leaves about 10 machine precisions of that sum.
    rounding: float = 1e3 * float(np.finfo(np.float64).eps)
    # Further pairs that are asked for, which tell whether the last one belongs to a cluster
    extra: int = 2
    # Relative residual at which a value that may have been missed has converged
    doubtful: float = 1e-3


@dataclass(frozen=True)
class Eigenpairs:
    """Eigenpairs in order, and how many motions take no energy."""

    values: Array  # λ, shape (n,) [1/s²]
    vectors: list[PETSc.Vec]  # φ of each, φᵀMφ = 1; `destroy` frees them
    rigid: int  # number of zero eigenvalues, which are not among the pairs

    def destroy(self) -> None:
        """Free the vectors. Collective."""
        free(*self.vectors)


def lowest(
    K: PETSc.Mat,
    M: PETSc.Mat,
    count: int,
    motions: Sequence[PETSc.Vec] = (),
    control: EigenControl | None = None,
    scale: float = 0.0,
) -> Eigenpairs:
    """The lowest eigenpairs, at least so many, zero ones left out. Collective.

    The last cluster is whole; there are fewer where there are no more. K and M are symmetric, M is
    positive definite; zero eigenvalues are those of motions without energy, to which combinations
    of the rigid motions may belong. Rounding of loads may be all of an eigenvalue below their λ,
    the scale [1/s²]. `SceneError` if SLEPc is not installed, or finds no eigenpairs.
    """
    control = EigenControl() if control is None else control
    check_installed()
    if K.getSize()[0] == 0:
        return Eigenpairs(np.empty(0), [], 0)
    K = K.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
    for A in (K, M):
        A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    search = _Search(K, M, control, scale)
    try:
        return search.lowest(count, motions)
    except PETSc.Error as error:
        raise _NotFound(
            f"modes: no eigenpairs were found ({error}). Check that every part has mass and "
            "stiffness."
        ) from error
    finally:
        free(search, K)


def clusters(values: Array, gap: float) -> Ints:
    """Number of the cluster of each sorted value; neighbours in one are a relative gap apart."""
    size = np.maximum(np.abs(values[1:]), np.abs(values[:-1]))
    return np.asarray(np.r_[0, np.cumsum(np.diff(values) > gap * size)][: values.size])


class _Search:
    """One search: K, M, and the factors for the present shift."""

    def __init__(self, K: PETSc.Mat, M: PETSc.Mat, control: EigenControl, scale: float) -> None:
        self._K, self._M, self._control, self._of_loads = K, M, control, scale
        self._size = int(K.getSize()[0])
        self._diagonal = K.getDiagonal()
        self._work = K.createVecRight()
        m = M.getDiagonal()
        ratio = np.divide(
            np.abs(self._diagonal.array_r), m.array_r, out=np.zeros(m.local_size), where=m.array > 0
        )
        m.destroy()
        self._scale = float(K.comm.tompi4py().allreduce(ratio.max(initial=0.0), op=MPI.MAX))
        self._shift = control.shift * self._scale
        self._still: list[PETSc.Vec] = []  # motions without energy, kept out of the iteration

    def lowest(self, count: int, motions: Sequence[PETSc.Vec]) -> Eigenpairs:
        if self._size > self._control.dense and len(motions):
            self._still = self._without_energy(motions)
        values, vectors = self._found(count)
        zero = self._zeros(values, vectors)
        elastic = np.flatnonzero(~zero)
        kept = elastic[: self._cut(values[elastic], count)]
        free(*(vectors[k] for k in np.setdiff1d(np.arange(values.size), kept)))
        rigid = int(zero.sum()) + len(self._still)
        return Eigenpairs(values[kept], [vectors[k] for k in kept], rigid)

    def destroy(self) -> None:
        """Free the vectors. Collective."""
        free(*self._still, self._diagonal, self._work)

    def _without_energy(self, motions: Sequence[PETSc.Vec]) -> list[PETSc.Vec]:
        """Combinations of motions whose eigenvalue is zero, φᵀMφ = 1."""
        vectors = [v.copy() for v in motions]
        stiffness, mass = self._grams(vectors)
        sizes = np.sqrt(np.maximum(mass.diagonal(), np.finfo(np.float64).tiny))
        shares, basis = eigh(mass / np.outer(sizes, sizes))
        whole = shares > self._control.rounding * shares[-1]
        basis = basis[:, whole] / np.sqrt(shares[whole]) / sizes[:, None]
        values, turn = eigh(basis.T @ stiffness @ basis)
        values, turn = self._K.comm.tompi4py().bcast((values, basis @ turn))
        spare = vectors[values.size :]
        _combine(vectors, turn)
        vectors = vectors[: values.size]
        still = self._zeros(values, vectors)
        free(*spare, *(v for v, no in zip(vectors, ~still, strict=True) if no))
        return [v for v, yes in zip(vectors, still, strict=True) if yes]

    def _found(self, count: int) -> tuple[Array, list[PETSc.Vec]]:
        """Enough of the lowest pairs, with those that a first iteration may have missed."""
        size = self._size - len(self._still)
        whole = self._size <= self._control.dense
        asked = size if whole else min(count + self._control.extra, size)
        eps = eigensolver(
            self._K, self._M, None if whole else self._shift, asked, self._control.tolerance
        )
        values, vectors = self._ritz(self._next(eps, asked, []))
        lowest = np.abs(values[~self._zeros(values, vectors)]).min(initial=np.inf)
        if not whole and self._shift > self._control.high * lowest:
            self._shift = 0.1 * float(lowest)
            free(*vectors, eps)
            return self._found(count)
        while len(vectors) < size:
            elastic = values[~self._zeros(values, vectors)]
            if self._cut(elastic, count) is None:
                eps.setTolerances(self._control.tolerance, MOST)
                lacking = max(count - elastic.size, 0) + self._control.extra
                values, vectors = self._ritz([*vectors, *self._next(eps, lacking, vectors)])
                continue
            eps.setTolerances(self._control.doubtful, MOST)
            more = self._next(eps, 1, vectors)
            if self._quotient(more[0]) > values[-1] * (1 + 1e-6 * np.sign(values[-1])):
                free(*more)
                break
            eps.setTolerances(self._control.tolerance, MOST)
            eps.setInitialSpace(more)
            missed = self._next(eps, 1, vectors)
            free(*more)
            values, vectors = self._ritz([*vectors, *missed])
        eps.destroy()
        return values, vectors

    def _cut(self, values: Array, count: int) -> int | None:
        """How many of the values to keep, so that no cluster is cut; None to ask for more."""
        if values.size <= count:
            return None
        of = clusters(values, self._control.gap)
        end = int(np.searchsorted(of, of[count - 1], side="right"))
        return end if end < values.size else None

    def _zeros(self, values: Array, vectors: list[PETSc.Vec]) -> Bools:
        """Whether each value is none but for rounding."""
        sizes = []
        for vector in vectors:
            self._work.pointwiseMult(self._diagonal, vector)
            sizes.append(abs(self._work.dot(vector)))
        # What LAPACK leaves of values that are found together:
        left = np.finfo(np.float64).eps * values.size * np.abs(values).max(initial=0.0)
        left += self._control.rounding * self._of_loads
        return np.asarray(np.abs(values) <= self._control.rounding * np.array(sizes) + left)

    def _next(self, eps: Any, count: int, found: list[PETSc.Vec]) -> list[PETSc.Vec]:
        """Vectors of the lowest eigenvalues in the complement of those found and of still ones.

        It is a `SceneError` if there is none.
        """
        apart = [*self._still, *found]
        count = min(count, self._size - len(apart))
        space = min(2 * count + 12, self._size)
        eps.setDimensions(count, space, space)
        if apart:
            eps.setDeflationSpace(apart)
        eps.solve()
        out = []
        for k in range(min(eps.getConverged(), count)):
            vector = self._K.createVecRight()
            eps.getEigenvector(k, vector)
            out.append(vector)
        if not out:
            raise SceneError("modes: SLEPc's iteration has found no further eigenpair.")
        return out

    def _quotient(self, vector: PETSc.Vec) -> float:
        self._K.mult(vector, self._work)
        up = float(self._work.dot(vector))
        self._M.mult(vector, self._work)
        return up / float(self._work.dot(vector))

    def _ritz(self, vectors: list[PETSc.Vec]) -> tuple[Array, list[PETSc.Vec]]:
        """Eigenpairs of K and M in the span of vectors, which are changed."""
        grams = self._grams(vectors)
        comm = self._K.comm.tompi4py()
        values, turn = comm.bcast(eigh(*grams) if comm.rank == 0 else None)
        _combine(vectors, turn)
        return np.asarray(values), vectors

    def _grams(self, vectors: list[PETSc.Vec]) -> tuple[Array, Array]:
        """Products of vectors by K and by M, shape (n, n) each."""
        grams = []
        for A in (self._K, self._M):
            gram = np.empty((len(vectors), len(vectors)))
            for k, vector in enumerate(vectors):
                A.mult(vector, self._work)
                gram[:, k] = self._work.mDot(vectors)
            grams.append(0.5 * (gram + gram.T))
        return grams[0], grams[1]


def _combine(vectors: list[PETSc.Vec], turn: Array) -> None:
    """Turn the first vectors into combinations of all, a column of a matrix each."""
    turned = turn.T @ np.stack([vector.array_r for vector in vectors])
    for vector, row in zip(vectors[: len(turned)], turned, strict=True):
        vector.array[:] = row
