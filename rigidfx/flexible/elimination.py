"""Kernels of forms in which enhanced strains are eliminated within each cell.

FFCx compiles a form with enhancements as coefficients and eliminations as constants, see
`rigidfx.mechanics.enhanced`. Its kernels are called by `elimination.c`, which first computes the
enhancements from displacements, and at last subtracts the loss by elimination from a matrix. λ, μ
and the direction of the thickness come with the coefficients, all else from the cell's corners.
"""

import weakref
from collections.abc import Sequence
from copy import copy
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from ffcx.codegeneration import get_include_path
from ufl.algorithms.analysis import extract_coefficients, extract_constants
from ufl.constantvalue import Zero

from rigidfx.base.c_library import c_library
from rigidfx.base.form_cache import compile_values
from rigidfx.mechanics.enhanced import AssumedWork, Elimination, Enhancement, Note, ProjectedWork

MOVES, STRAINS, BLOCKS, PORTIONS, WORKS, READS, LARGEST = 4, 8, 4, 8, 4, 16, 1024  # as in C
SLOTS = 1024  # kernels that may live at a time

SOURCES = [
    Path(__file__).with_name(f"{name}.c")
    for name in ("enhanced", "enhanced_rows", "assumed", "projected", "elimination")
]
DECLARED = """
typedef struct {
  void *kernel;
  int reads, read_from[16], read_size[16];
  int constants, constant_from[16], constant_size[16];
  int law;
  double middle[4];
  int by;
} work_t;
typedef struct {
  void *kernel;
  int size, moves;
  int place[4];
  int strains;
  int at[8], source[8], end[8], start[8];
  int blocks;
  int law[4];
  double left[4][4], right[4][4];
  double factor[4];
  int more[4];
  int rank;
  int portions;
  int portion_law[8], portion_end[8], portion_start[8];
  double portion_factor[8];
  int portion_more[8];
  double middle[4];
  int by;
  int works;
  work_t work[4];
} closure_t;
extern closure_t closures[1024];
extern void *slots[1024];
void prepare(void);
void prepare_assumed(void);
void enhancements(int, const double *, const double *, const double *, double *);
"""

_free: dict[str, list[int]] = {}  # slots of each library


def alive() -> int:
    """How many kernels with enhanced strains live in this process."""
    return sum(SLOTS - len(free) for free in _free.values())


def eliminate(mesh: Any, form: ufl.Form, compiled: Any, options: dict[str, Any]) -> Any:
    """A compiled form whose cell kernels eliminate; the same form if it has no enhancements.

    Kernels live as long as the returned object, which any form bound from it has to hold. It is a
    `RuntimeError` if more are alive than there is room for. Collective on the mesh.
    """
    if not any(isinstance(w, Enhancement) for w in form.coefficients()):
        return compiled
    library, free = library_of(mesh.comm, options["cffi_extra_compile_args"])
    ffi, old = compiled.module.ffi, compiled.ufcx_form
    first, last, total = (old.form_integral_offsets[k] for k in (0, 1, 3))
    integrals = ffi.new("ufcx_integral*[]", [old.form_integrals[k] for k in range(total)])
    kept: list[Any] = [integrals]
    for k in range(first, last):
        if not free:
            raise RuntimeError(f"More than {SLOTS} kernels with enhanced strains are alive.")
        slot = free.pop()
        closure = library.lib.closures[slot]
        works = _works(form, old.form_integral_ids[k])
        needed = _fill(closure, form, old, old.form_integral_ids[k], works)
        for n, note in enumerate(works):
            found, module = _values(mesh.comm, closure.work[n], note, form, old, options)
            closure.work[n].kernel = library.ffi.cast("void *", found)
            kept.append(module)
        address = int(ffi.cast("uintptr_t", old.form_integrals[k].tabulate_tensor_float64))
        silent = _only_notes(form, old.form_integral_ids[k])
        closure.kernel = library.ffi.cast("void *", 0 if silent else address)
        kernel = ffi.new("ufcx_integral*", old.form_integrals[k][0])
        enabled = kernel.enabled_coefficients
        packed = [needed.get(n, enabled[n]) for n in range(old.num_coefficients)]
        flags = ffi.new("bool[]", packed)
        kernel.enabled_coefficients = flags
        at = int(library.ffi.cast("uintptr_t", library.lib.slots[slot]))
        kernel.tabulate_tensor_float64 = ffi.cast("ufcx_tabulate_tensor_float64*", at)
        weakref.finalize(kernel, free.append, slot)
        integrals[k] = kernel
        kept += [kernel, flags]
    new = ffi.new("ufcx_form*", old)
    new.form_integrals = integrals
    out = copy(compiled)
    out.ufcx_form, out.kept = new[0], kept
    return out


def _fill(
    closure: Any, form: ufl.Form, compiled: Any, number: int, other: list[ProjectedWork]
) -> dict[int, bool]:
    """Write down the data of the kernel of a subdomain id.

    Which coefficients have to be packed is returned: displacements, and of enhancements one for
    each pair of λ and μ.
    """
    used, places = _places(form, compiled)
    constants = _constant_places(form)
    parts = [i for i in form.integrals_by_type("cell") if number in np.atleast_1d(i.subdomain_id())]
    of = [w for w in extract_coefficients(ufl.Form(parts)) if isinstance(w, Enhancement)]
    blocks = [c for c in extract_constants(ufl.Form(parts)) if isinstance(c, Elimination)]
    works = [c for c in extract_constants(ufl.Form(parts)) if isinstance(c, AssumedWork)]
    numbers = {n for w in of for n in (w.end, w.start) if n is not None}
    numbers |= {n for w in other for n in w.middle}
    moves = sorted(numbers.union(*(b.left for b in blocks), *map(_displacements, works)))
    closure.size = places[-1]
    closure.moves, closure.strains, closure.blocks = len(moves), len(of), len(blocks)
    portions = [portion for work in works for portion in work.portions]
    asked = len(moves), len(of), len(blocks), len(portions), len(other), places[-1]
    room = MOVES, STRAINS, BLOCKS, PORTIONS, WORKS, LARGEST
    if any(a > b for a, b in zip(asked, room, strict=True)):
        raise RuntimeError(f"A form with enhanced strains needs {asked} places, and has {room}.")
    for k, n in enumerate(moves):
        closure.place[k] = places[n]
    for k, w in enumerate(of):
        closure.at[k], closure.end[k] = places[w.count()], moves.index(w.end)
        closure.start[k] = -1 if w.start is None else moves.index(w.start)
        closure.source[k] = places[next(v for v in of if v.law is w.law).count()]
    for k, block in enumerate(blocks):
        closure.law[k] = of.index(block.enhancement)
        closure.factor[k] = block.factor
        closure.more[k] = -1 if block.more is None else constants[block.more]
        for m, n in enumerate(moves):
            closure.left[k][m] = block.left.count(n) / len(block.left)
            closure.right[k][m] = float(n == block.right)
    closure.rank, closure.portions = compiled.rank, len(portions)
    for k, (law, end, start, factor, more) in enumerate(portions):
        closure.portion_law[k] = next(i for i, v in enumerate(of) if v.law is law)
        closure.portion_end[k] = moves.index(end)
        closure.portion_start[k] = -1 if start is None else moves.index(start)
        closure.portion_factor[k] = factor
        closure.portion_more[k] = -1 if more is None else constants[more]
    for work in works[:1]:  # a form's stresses do work at one place
        closure.by = moves.index(work.by)
        for m, n in enumerate(moves):
            closure.middle[m] = work.middle.count(n) / len(work.middle)
    closure.works = len(other)
    for to, note in zip(closure.work, other, strict=False):
        to.law, to.by = of.index(note.enhancements[0]), moves.index(note.by)
        for m, n in enumerate(moves):
            to.middle[m] = note.middle.count(n) / len(note.middle)
    firsts = {next(v for v in of if v.law is w.law).count() for w in of}
    needed = {k: w.count() in firsts for k, w in enumerate(used) if w in of}
    return needed | {k: True for k, w in enumerate(used) if w.count() in moves}


def _only_notes(form: ufl.Form, number: int) -> bool:
    """Whether the kernel of a subdomain id has only constants of zero."""
    zeros = {c: ufl.zero() for c in extract_constants(form) if isinstance(c, Note)}
    parts = [i for i in form.integrals_by_type("cell") if number in np.atleast_1d(i.subdomain_id())]
    return all(isinstance(ufl.replace(i.integrand(), zeros), Zero) for i in parts)


def _works(form: ufl.Form, number: int) -> list[ProjectedWork]:
    """Stresses that are not linear in the kernel of a subdomain id."""
    parts = [i for i in form.integrals_by_type("cell") if number in np.atleast_1d(i.subdomain_id())]
    return [c for c in extract_constants(ufl.Form(parts)) if isinstance(c, ProjectedWork)]


def _values(
    comm: Any,
    work: Any,
    note: ProjectedWork,
    form: ufl.Form,
    compiled: Any,
    options: dict[str, Any],
) -> tuple[int, Any]:
    """Compile the kernels at the points, and write down where they read. Collective.

    The kernel's address, and the objects to be held as long as it is called, are returned.
    """
    values = note.at_points(compiled.rank == 2)
    points, _ = note.enhancements[0].ufl_element().custom_quadrature()
    expression, module = compile_values(comm, values, points, options)
    _, places = _places(form, compiled)
    constants = _constant_places(form)
    given, positions = extract_coefficients(values), expression.original_coefficient_positions
    used = [given[positions[k]] for k in range(expression.num_coefficients)]
    read = extract_constants(values)
    if max(len(used), len(read)) > READS:
        raise RuntimeError(f"A stress with enhanced strains reads more than {READS} values.")
    work.reads, work.constants = len(used), len(read)
    for k, w in enumerate(used):
        work.read_from[k], work.read_size[k] = places[w.count()], w.ufl_element().dim
    for k, c in enumerate(read):
        work.constant_from[k] = constants[c]
        work.constant_size[k] = int(np.prod(c.ufl_shape, dtype=int))
    address = int(module.ffi.cast("uintptr_t", expression.tabulate_tensor_float64))
    return address, (expression, module)


def _displacements(work: AssumedWork) -> set[int]:
    """The numbers of those that it depends on."""
    ends = {n for _, end, start, *_ in work.portions for n in (end, start) if n is not None}
    return ends | set(work.middle)


def _places(form: ufl.Form, compiled: Any) -> tuple[list[Any], dict[int, int]]:
    """The coefficients of a cell and where the values of each begin; where all end under -1."""
    coefficients = extract_coefficients(form)
    positions = compiled.original_coefficient_positions
    used = [coefficients[positions[k]] for k in range(compiled.num_coefficients)]
    ends = np.cumsum([0, *(w.ufl_element().dim for w in used)])
    at = {w.count(): int(end) for w, end in zip(used, ends, strict=False)}
    return used, at | {-1: int(ends[-1])}


def _constant_places(form: ufl.Form) -> dict[Any, int]:
    """Where the values of each constant are."""
    constants = extract_constants(form)
    ends = np.cumsum([0, *(int(np.prod(c.ufl_shape, dtype=int)) for c in constants)])
    return dict(zip(constants, (int(at) for at in ends), strict=False))


def library_of(comm: Any, flags: Sequence[str]) -> tuple[Any, list[int]]:
    """The C code with its slots, for the interface of this FFCx, and the free ones. Collective."""
    header = (Path(get_include_path()) / "ufcx.h").read_text()
    custom = "custom_data" in header
    extra = {"_TYPE": ", void *", "": ", void *custom", "_NAME": ", custom"}
    lines = [f"#define KERNEL_EXTRA{name} {text * custom}" for name, text in extra.items()]
    lines += [source.read_text() for source in SOURCES]
    lines += [f"SLOT({k})" for k in range(SLOTS)]
    lines.append("void *slots[] = {" + ", ".join(f"(void *)slot_{k}" for k in range(SLOTS)) + "};")
    library = c_library(comm, "elimination", "\n".join(lines), DECLARED, flags)
    if library.__name__ not in _free:
        library.lib.prepare()
        library.lib.prepare_assumed()
        _free[library.__name__] = list(range(SLOTS))
    return library, _free[library.__name__]
