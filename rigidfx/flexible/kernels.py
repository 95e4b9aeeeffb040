"""Compile a form once, bind it to cells as often as needed, in well under a millisecond.

RIGIDFX_KERNEL_FLAGS names the C compiler's flags in place of those of `jit_options`: "-O2" for sums
in the order of the forms, "-O3 -march=x86-64-v3" for one cache on different processors. Each set of
flags has compiled forms of its own. Cells whose materials share an energy function share a kernel.
A parameter that has one value within a class is a constant, one that varies is a coefficient.
"""

import hashlib
import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from ufl.algorithms import expand_derivatives

from rigidfx.base.c_library import compiles
from rigidfx.base.compat import bindable
from rigidfx.base.errors import CompilerError, SceneError
from rigidfx.base.form_cache import compile_form
from rigidfx.base.inputs import shown
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.effects import Effect
from rigidfx.flexible.dealt_cells import DealtCells
from rigidfx.flexible.elimination import eliminate
from rigidfx.mechanics.enhanced import Enhancement, Note
from rigidfx.mechanics.materials import Energy
from rigidfx.mechanics.schemes import Law
from rigidfx.scene.scene import Scene

FLAGS = "RIGIDFX_KERNEL_FLAGS"  # environment variable: the compiler's flags, as in a shell


@cache
def _processor() -> str:
    """A short name of this machine's instruction set."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return hashlib.sha1(flags.encode()).hexdigest()[:12]


def jit_options() -> dict[str, Any]:
    """Options for FFCx's compiler, from the environment or the default.

    The default's floating-point flags allow sums to be regrouped, which lets a tangent kernel use
    the vector units (a third off its time), and products to be added without a rounding between,
    which FFCx's -std=c17 rules out (a tenth off its time, and some of the compiler's); they keep
    NaN and infinity meaningful and leave the handling of denormal numbers alone, unlike
    -ffast-math. Nothing is kept for debuggers (-g0), which took a quarter to a third of the
    compiler's time. -O1 takes half of the compiler's time, three times that of tangents and twice
    that of residuals and energies (hexahedra of second order); -O2 saves little.

    Raises:
        SceneError: If the environment's flags cannot be told apart, as a quote is left open.
    """
    flags = _flags_given() or [
        "-O3",
        "-g0",  # Python's own flags ask for -g
        "-march=native",
        "-ffp-contract=fast",
        "-fno-math-errno",
        "-fno-trapping-math",
        "-fassociative-math",
        "-fno-signed-zeros",
        "-freciprocal-math",
    ]
    # FFCx's cache tells objects apart by these flags, but not what -march=native stands for.
    if any(flag.endswith("=native") for flag in flags):
        flags.append(f"-DRIGIDFX_PROCESSOR_{_processor()}")
    return {"timeout": 10, "cffi_extra_compile_args": flags}


def _flags_given() -> list[str]:
    given = os.environ.get(FLAGS, "")
    try:
        return [*_split(given)]
    except ValueError as error:
        raise SceneError(
            f"The environment variable {FLAGS} must hold the C compiler's flags as in a shell, "
            f"such as '-O2 -g0', got {shown(given)}: {error}."
        ) from None


@cache
def _split(text: str) -> tuple[str, ...]:
    """Words as a shell finds them."""
    return tuple(shlex.split(text))


class Kernel:
    """A compiled form without cells.

    Args:
        form: UFL form; its integrals carry the subdomain ids that `bind` refers to.
        arguments: Function spaces of its arguments.
        mesh: Mesh of its coefficients. Compilation is collective on the mesh's communicator.

    Attributes:
        form: The compiled form.
    """

    def __init__(self, form: ufl.Form, arguments: list[Any], mesh: Any) -> None:
        """Compile the form. Collective.

        If the C compiler cannot be run, or fails, it is a `CompilerError` on every rank; if it
        fails by the environment's flags, a `SceneError`.
        """
        # FFCx applies derivatives when it compiles. To do so here would take longer than to find a
        # form among those that are compiled already; but an elimination is told by what is left.
        if any(isinstance(w, Enhancement) for w in form.coefficients()):
            form = expand_derivatives(form)
        self.form = form
        try:
            compiled = compile_form(mesh.comm, form, jit_options())
            compiled = eliminate(mesh, form, compiled, jit_options())
        except CompilerError as error:
            given = os.environ.get(FLAGS)
            if not given or not compiles(mesh.comm):
                raise
            raise SceneError(
                f"The C compiler cannot make a kernel with the flags {given!r}, which the "
                f"environment variable {FLAGS} holds: correct or unset it. ({error})"
            ) from error
        self._compiled, coefficients = bindable(compiled)
        self._arguments = arguments
        self._mesh = mesh
        self._coefficients = {w: w.law if isinstance(w, Enhancement) else w for w in coefficients}
        zero = fem.Constant(mesh, 0.0)
        self._constants = {c: zero if isinstance(c, Note) else c for c in form.constants()}

    @property
    def library(self) -> Path:
        """The file that the compiler has made of it."""
        return Path(self._compiled.module.__file__)

    @property
    def ids(self) -> set[int]:
        """Subdomain ids of its cell integrals."""
        parts = (i for i in self.form.integrals() if i.integral_type() == "cell")
        return {int(n) for i in parts for n in np.atleast_1d(i.subdomain_id())}

    def bind(
        self,
        cells: Mapping[int, Indices],
        facets: Mapping[int, Indices] | None = None,
        instead: Mapping[fem.Function, fem.Function] | None = None,
        dealt: DealtCells | None = None,
    ) -> fem.Form:
        """The form over owned cells and facets by subdomain id. Collective if they are dealt.

        Cells are sorted; boundary facets are cells and local numbers, shape (n, 2). Functions may
        be read instead of coefficients, and the form may be over dealt copies.
        """
        read = {w: (instead or {}).get(w, f) for w, f in self._coefficients.items()}
        arguments, mesh = self._arguments, self._mesh
        if dealt is not None:
            cells = {i: dealt.cells(own) for i, own in cells.items()}
            facets = {i: dealt.facets(pairs) for i, pairs in (facets or {}).items()}
            read = {w: dealt.copy(f) for w, f in read.items()}
            arguments, mesh = [dealt.space] * len(arguments), dealt.mesh
        domains: dict[Any, list[tuple[int, Any]]] = {fem.IntegralType.cell: sorted(cells.items())}
        if facets:
            domains[fem.IntegralType.exterior_facet] = [
                (i, pairs.reshape(-1)) for i, pairs in sorted(facets.items())
            ]
        form = fem.create_form(self._compiled, arguments, mesh, domains, read, self._constants)
        form.kernel = self._compiled  # holds what it calls as long as the form may call it
        form.reaches = any(len(own) for parts in domains.values() for _, own in parts)
        return form


# A step without flexible cells is so short that the mere calls of DOLFINx would count.


def integral(form: fem.Form) -> float:
    """The value on this rank of a bound form without arguments."""
    return float(fem.assemble_scalar(form)) if form.reaches else 0.0


def add_vector(values: Array, form: fem.Form) -> None:
    """Add a bound linear form of this rank's cells to the numbers of its local dofs."""
    if form.reaches:
        fem.assemble_vector(values, form)


@dataclass(frozen=True)
class MaterialClass:
    """Cells whose materials share an energy function, and on which the same effects may act."""

    law: Law  # their stored energy
    effects: tuple[int, ...]  # which of the effects told apart may act on them
    cells: Indices  # owned cells, sorted


def material_classes(scene: Scene, effects: Sequence[Effect] = ()) -> list[MaterialClass]:
    """Classes of owned cells, told apart by effects, the same on all ranks. Collective."""
    owned = scene.owned_cells(None, "")
    covered = np.zeros((owned.size, len(effects)), dtype=bool)
    for k, effect in enumerate(effects):
        covered[scene.owned_cells(getattr(effect, "where", None), effect.kind), k] = True
    members: dict[tuple[Energy, bool, tuple[int, ...]], list[Any]] = {}
    for material, cells in scene.materials:
        for numbers in _combinations(scene, covered[cells]):
            own = cells[(covered[cells] == np.isin(np.arange(len(effects)), numbers)).all(axis=1)]
            key = material.energy, material.quadratic, numbers
            members.setdefault(key, []).append((material, own))
    return [
        MaterialClass(
            Law(energy, quadratic, _parameters(scene, pairs)),
            numbers,
            np.sort(np.concatenate([cells for _, cells in pairs])),
        )
        for (energy, quadratic, numbers), pairs in members.items()
    ]


def _parameters(scene: Scene, pairs: Sequence[Any]) -> dict[str, Any]:
    """Constants, or piecewise constant functions, from pairs of a material and its cells."""
    out: dict[str, Any] = {}
    for name in pairs[0][0].parameters:
        values = [(m.parameters[name], cells) for m, cells in pairs]
        same = len({value for value, _ in values}) == 1
        out[name] = (
            fem.Constant(scene.mesh, float(values[0][0])) if same else scene.cellwise(values)
        )
    return out


def _combinations(scene: Scene, covered: Bools) -> list[tuple[int, ...]]:
    """Which effects act together on any cell of any rank, the same list on all. Collective."""
    if covered.shape[1] == 0:
        return [()]
    mine = {tuple(int(k) for k in np.flatnonzero(row)) for row in np.unique(covered, axis=0)}
    return sorted(set().union(*scene.comm.allgather(mine)))
