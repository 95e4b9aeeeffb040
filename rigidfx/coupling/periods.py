"""Periods of small free vibrations about the undeformed shape, as a scene begins.

    K φ = ω² M φ,    T = 2π/ω

with the cells' stiffness without stress, springs, the supports that act at t = 0, the mass of the
run, and parts named rigid as six unknowns each, PᵀKP and PᵀMP with rows [I, -x̂/ℓ] at their nodes.
Loads, their stresses and contacts are not in it.

The matrices are gathered: rank 0 factors K + σM by MUMPS, and ARPACK (R.B. Lehoucq, D.C. Sorensen
and C. Yang, ARPACK Users' Guide, 1998, doi:10.1137/1.9780898719628) iterates with its inverse. The
shift σ is small against the squares of all but rigid motions, which have no period.
"""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import eigh
from scipy.sparse import csc_array, csr_array, diags_array, eye_array, hstack, kron, vstack
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from rigidfx.base.errors import SceneError, agree
from rigidfx.base.inputs import whole
from rigidfx.coupling.mass import mass_operator
from rigidfx.coupling.rows import Rows
from rigidfx.flexible.kernels import Kernel
from rigidfx.flexible.material_classes import material_classes
from rigidfx.mechanics.schemes import static_virtual_work
from rigidfx.scene.scene import Scene
from rigidfx.scene.summary import FURTHER

__all__ = ["periods", "periods_in_words"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Sparse = Any

CHEAP = 12_000  # unknowns up to which a description has periods unasked
DENSE = 300  # unknowns up to which all are found at once
SHIFT = 1e-10  # σ, of the largest ω²
ROUNDING = 1e4 * np.finfo(float).eps  # of |φ|·|P|ᵀ|K||P||φ|: less is no stiffness


def periods(scene: Scene, count: int = 3) -> Array:
    """The longest periods of small free vibrations of a scene as it begins. Collective.

    About the undeformed shape, without loads, contacts and damping; under the supports that act at
    t = 0. Parts named `Rigid` are rigid. Equal ones, as of a square bar, come as often as they are.

    Args:
        scene: The problem.
        count: How many, 1 or more.

    Returns:
        T [s], the longest first; fewer than asked for where a scene has fewer. Rigid motions that
        supports and springs leave free are left out.

    Raises:
        SceneError: If there is no scene, the count is none, the mass of a part named rigid is
            given, or there are too many motions without stiffness for the others to be found.
    """
    if not isinstance(scene, Scene):
        raise SceneError(f"periods: scene must be a Scene, got {type(scene).__name__}.")
    count, comm = whole("periods", "count", count, least=1), scene.comm
    agree(comm, _unanswered(scene))
    K, M, held, parts = _problem(scene)
    found, problem = None, None
    if comm.rank == 0:
        try:
            found = _longest(K, M, _motions(held, parts), count)
        except (ArpackError, np.linalg.LinAlgError, ValueError, PETSc.Error) as error:
            problem = f"periods: they were not found ({error})."
    agree(comm, problem)
    return np.asarray(comm.bcast(found))


def periods_in_words(scene: Scene, dt: float | None, count: int | None) -> list[str]:
    """The line of a description: the periods asked for, or three where they are cheap. Collective.

    Args:
        scene: The problem.
        dt: Time step that is thought of [s], if any.
        count: How many; three up to `CHEAP` unknowns if None.
    """
    if count == 0:
        return []
    if count is None and 3 * scene.space.dofmap.index_map.size_global > CHEAP:
        return ["Periods of small vibrations: describe(periods=3) finds them, in some seconds"]
    try:
        found = periods(scene, 3 if count is None else count)
    except SceneError:
        if count is not None:
            raise
        return []  # nobody has asked
    if not found.size:
        return ["Periods: none, as nothing can vibrate"]
    text = ", ".join(f"{T:.4g}" for T in found)
    steps = "" if dt is None else f"; the first is {found[0] / dt:.3g} steps of Δt = {dt:g} s"
    return [f"Periods of small vibrations as it begins, without loads: {text} s{steps}"]


FURTHER.append(periods_in_words)


def _unanswered(scene: Scene) -> str | None:
    """Why a scene's periods are not known, None if they are."""
    if any(effect.is_rigid and getattr(effect, "given", False) for effect in scene.effects):
        return "periods: they are not found where the mass or inertia of a Rigid part is given."
    return None


def _problem(scene: Scene) -> tuple[Sparse, Sparse, Flags, Array]:
    """K and M over all dofs, whether supports hold each, and its rigid part from 1 on. Collective.

    Returns:
        On rank 0, what is said, in the order of the ranks' nodes; the last is 0 at flexible nodes,
        one number per node.
    """
    n, comm = scene.owned_nodes, scene.comm
    classes = material_classes(scene)
    cells = {i: c.cells for i, c in enumerate(classes, start=1)}
    rows = Rows(scene.space, np.arange(n, dtype=np.int32))
    form = _stiffness(scene, classes).bind(cells)
    A = rows.matrix(form)
    fem_petsc.assemble_matrix(A, form)
    A.assemble()
    mass = mass_operator(scene, rows, cells, np.ones(n, dtype=bool))
    B = mass.matrix()
    K, M = _gathered(A), _gathered(B)
    for item in (A, B, mass):
        item.destroy()
    for effect in scene.effects:
        if effect.ground_stiffness is None:
            continue
        weights = scene.shares(getattr(effect, "where", ""), effect.kind)[:n]
        every = comm.gather(weights)
        if every is not None:
            K = K + kron(diags_array(np.concatenate(every)), effect.ground_stiffness)
    held, part = np.zeros((len(scene.nodal_mass), 3), bool), np.zeros(len(scene.nodal_mass))
    for support, nodes in scene.supports:
        if support.acts(0.0):
            held[np.ix_(nodes, support.axes)] = True
    named = [effect for effect in scene.effects if effect.is_rigid]
    for k, effect in enumerate(named, start=1):
        where = getattr(effect, "where", None)
        part[slice(None) if where is None else scene.nodes(where, effect.kind, (3,))] = k
    X = scene.space.tabulate_dof_coordinates()[:n]
    own = comm.gather((held[:n], np.c_[part[:n], X]))
    if own is None:
        return None, None, held, part
    return K, M, *(np.concatenate(arrays) for arrays in zip(*own, strict=True))


def _stiffness(scene: Scene, classes: Any) -> Kernel:
    """The derivative of static forces without displacement. Collective."""
    V, element, u = scene.space, scene.element, fem.Function(scene.space)
    w, du = ufl.TestFunction(V), ufl.TrialFunction(V)
    work, less = ufl.Form([]), ufl.Form([])
    for i, c in enumerate(classes, start=1):
        work += static_virtual_work(element, c.law, u, w) * scene.cell_measure(i)
        lost = element.eliminated((u,), u, 1.0, None, w, du)
        if lost is not None:
            less += lost * scene.cell_measure(i)
    return Kernel(ufl.derivative(work, u, du) + less, [V, V], scene.mesh)


def _gathered(A: PETSc.Mat) -> Sparse:
    """A matrix on rank 0, None on others. Collective."""
    comm: MPI.Intracomm = A.comm.tompi4py()
    offsets, columns, values = A.getValuesCSR()
    parts = comm.gather((values, columns, offsets))
    if parts is None:
        return None
    width = A.getSize()[1]
    return vstack([csr_array(p, shape=(len(p[2]) - 1, width)) for p in parts], format="csr")


def _motions(held: Flags, parts: Array) -> Sparse:
    """P: a column of each free dof, and six of each rigid part that no support holds."""
    number, X = parts[:, 0].astype(int), parts[:, 1:]
    eye = csc_array(eye_array(held.size))
    blocks = [eye[:, np.flatnonzero(~held.reshape(-1) & np.repeat(number == 0, 3))]]
    for k in range(1, number.max(initial=0) + 1):
        nodes = np.flatnonzero(number == k)
        if held[nodes].any():  # clamped as a whole, or refused by a run
            continue
        arm = X[nodes] - X[nodes].mean(axis=0)
        arm = arm / np.abs(arm).max()
        turned = np.cross(np.eye(3)[None], arm[:, None]).swapaxes(1, 2)
        motion = np.concatenate(
            [np.tile(np.eye(3), (nodes.size, 1)), turned.reshape(-1, 3)], axis=1
        )
        places = (3 * nodes[:, None] + np.arange(3)).reshape(-1)
        blocks.append(eye[:, places] @ csc_array(motion))
    return csr_array(hstack(blocks))


def _longest(K: Sparse, M: Sparse, P: Sparse, count: int) -> Array:
    """The longest periods of PᵀKP φ = ω² PᵀMP φ that have one [s]."""
    size, asked = P.shape[1], count + 6
    if size == 0:
        return np.empty(0)
    sums = abs(P).T @ abs(K) @ abs(P)
    K, M = csr_array(P.T @ K @ P), csr_array(P.T @ M @ P)
    while True:
        squares, shapes = _lowest(K, M, min(asked, size))
        sizes = np.abs(shapes)
        stiff = squares > ROUNDING * np.einsum("ij,ij->j", sizes, sums @ sizes)
        if np.count_nonzero(stiff) >= count or asked >= size:
            return np.asarray(2 * pi / np.sqrt(squares[stiff][:count]))
        asked *= 2


def _lowest(K: Sparse, M: Sparse, count: int) -> tuple[Array, Array]:
    """The least ω² and their φ, of unit mass; more of them where that is as cheap."""
    size = K.shape[0]
    if size <= DENSE or 2 * count >= size:
        squares, shapes = eigh(K.toarray(), M.toarray())
        return squares, shapes
    shift = SHIFT * float((K.diagonal() / M.diagonal()).max())
    solver = _solver(csr_array(K + shift * M))
    right, found = solver.getOperators()[0].createVecs()

    def solve(b: Array) -> Array:
        right.array[:] = b.reshape(-1)
        solver.solve(right, found)
        return found.array_r.copy()

    inverse = LinearOperator((size, size), matvec=solve, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(size)
    squares, shapes = eigsh(K, count, M=M, sigma=-shift, OPinv=inverse, v0=start)
    order = np.argsort(squares)
    for item in (right, found, solver):
        item.destroy()
    return squares[order], shapes[:, order]


def _solver(A: Sparse) -> PETSc.KSP:
    """The factors of a symmetric positive definite matrix on this rank; the caller destroys it."""
    kind = PETSc.IntType
    csr = A.indptr.astype(kind), A.indices.astype(kind), A.data
    matrix = PETSc.Mat().createAIJ(A.shape, csr=csr, comm=PETSc.COMM_SELF)
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    ksp = PETSc.KSP().create(PETSc.COMM_SELF)
    ksp.setOperators(matrix)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.setErrorIfNotConverged(True)
    factors = ksp.getPC()
    factors.setType(PETSc.PC.Type.CHOLESKY)
    factors.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
    matrix.destroy()  # its solver holds it
    return ksp
