"""Options of the command `rigidfx`, which all ranks read; without a file those of an example."""

import argparse
import re
import sys
from argparse import ArgumentTypeError, Namespace
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from mpi4py import MPI

GEO = (".geo", ".geo_unrolled")
STEPS = 400  # of a run whose Δt is not given
CAD = (".step", ".stp", ".brep", ".iges", ".igs")
MESHED = CAD + GEO, "what is meshed here"
INP = (".inp",), ".inp"
ONLY = {  # options that only some files have
    **{"size": MESHED, "curved": MESHED, "per_circle": (CAD, "CAD files"), "corners": INP},
    **{"encoding": INP, "name": (CAD, ", ".join(CAD)), "set": (GEO, ", ".join(GEO))},
}
SEVERAL: dict[str, Any] = {"action": "append", "default": []}


def say(text: str) -> None:
    """Print on rank 0."""
    if MPI.COMM_WORLD.rank == 0:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()


class RankParser(argparse.ArgumentParser):
    """A parser for scripts that run on several ranks: rank 0 alone prints."""

    def __init__(self, *given: Any, **how: Any) -> None:
        """Make a parser for which -1e4 is a number, as -10000 is, and no option."""
        super().__init__(*given, **how)
        self._negative_number_matcher = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")

    def error(self, message: str) -> NoReturn:
        """Stop with a message and status 2."""
        self.exit(2, f"{self.prog}: {message}\n")

    def _print_message(self, message: str, file: Any = None) -> None:
        if MPI.COMM_WORLD.rank == 0:
            super()._print_message(message, file)


def number(text: str) -> float:
    """A finite number."""
    with suppress(ValueError):
        if isfinite(value := float(text)):
            return value
    raise ArgumentTypeError(f"'{text}' is no finite number")


def count(text: str) -> int:
    """A whole number above zero."""
    if not text.isdecimal() or int(text) == 0:
        raise ArgumentTypeError(f"must be a whole number ≥ 1, got {text}")
    return int(text)


def positive(text: str) -> float:
    """A number above zero."""
    if number(text) <= 0:
        raise ArgumentTypeError(f"must be > 0, got {text}")
    return number(text)


def nonnegative(text: str) -> float:
    """A number that is not below zero."""
    if number(text) < 0:
        raise ArgumentTypeError(f"must be ≥ 0, got {text}")
    return number(text)


@dataclass(frozen=True)
class Example:
    """A script of gmsh that is run without a file: its support is named "wall", its load "end"."""

    file: Path  # the script
    out: Path  # folder for results


def ask(prog: str | None, example: Example | None) -> tuple[RankParser, Namespace]:
    """The options as given, checked as far as the file need not be read.

    To those of the command line are added: `example`, whether no file is given; `kind`, the file's
    ending; `surfaces` and `parameters`, what --name and --set say; `load` has forces as arrays [N].
    """
    parser = RankParser(
        prog,
        description="Simulate a geometry of your own; parts that hardly strain become rigid.",
        epilog="Names are physical names of gmsh, labels of CAD parts, or those given by --name. "
        "All is in SI units.",
    )
    _of_geometry(parser, optional=example is not None)
    _of_problem(parser)
    _of_run(parser, example)
    options = parser.parse_args()
    options.example = options.file is None
    if example is not None:
        _complete(options, example)
    options.order = options.order or 2
    if options.dt is None and options.t_end is not None:
        options.dt = options.t_end / STEPS
    if options.out is None:
        options.out = Path("out", options.file.stem)
    if options.until is None:  # loads stay in statics
        run = options.t_end is not None and not options.static
        options.until = options.t_end / 10 if run else np.inf
    options.kind = options.file.suffix.lower()
    for option, (kinds, these) in ONLY.items():
        if getattr(options, option) and options.kind not in kinds:
            shown = option.replace("_", "-")
            parser.error(f"--{shown} is for {these} only, not for '{options.file.name}'")
    options.surfaces = _pairs(parser, "name", options.name)
    options.parameters = _pairs(parser, "set", options.set)
    options.load = [(n, _three(parser, f"load {n}", texts)) for n, *texts in options.load]
    given = options.material
    options.material = {n: _three(parser, f"material {n}", texts) for n, *texts in given}
    if len(options.material) < len(given):
        parser.error("--material: a name is given twice")
    return parser, options


def _of_geometry(parser: RankParser, optional: bool) -> None:
    add = parser.add_argument_group("geometry").add_argument
    kinds = ".msh, .geo, .step, .iges, .brep, .inp, or .unv and others that gmsh reads"
    add("file", nargs="?" if optional else None, type=Path, help=kinds)
    add("--list", action="store_true", help="show what is in the file, and stop")
    add("--size", type=positive, help="largest edge of a cell [m] (.geo and CAD)")
    add("--per-circle", type=positive, help="cells around a full circle, along curved edges (CAD)")
    add("--curved", action="store_true", help="cells as curved as surfaces (.geo and CAD)")
    add("--scale", type=positive, default=1.0, help="metres per unit of the file (1)")
    add("--set", metavar="NAME=VALUE", **SEVERAL, help="parameter of a .geo script")
    add("--name", metavar="NAME=3,4", **SEVERAL, help="surfaces of CAD, by number")
    add("--encoding", help="of an .inp that is not in UTF-8, such as gb18030")
    add("--corners", action="store_true", help="cells of an .inp by their corners")
    told = "enhanced ones bend rightly with --order 1 (hexahedra)"
    add("--element", choices=["standard", "enhanced"], default="standard", help=told)
    add("--order", type=int, choices=[1, 2], help="of the displacement (2)")


def _of_problem(parser: RankParser) -> None:
    add = parser.add_argument_group("problem").add_argument
    add("--E", type=positive, default=2.1e11, help="Young's modulus [Pa] (2.1e11)")
    add("--nu", type=number, default=0.3, help="Poisson's ratio (0.3)")
    add("--rho", type=positive, default=7850.0, help="density [kg/m³] (7850)")
    told = "that of the cells NAME, in place of --E, --nu and --rho; once for each volume"
    add("--material", metavar=("NAME", "E", "NU", "RHO"), nargs=4, **SEVERAL, help=told)
    add("--hold", metavar="NAME[:xyz]", nargs="+", default=[], help="what is held")
    told = "a total force [N], spread evenly over the area of the facets NAME"
    add("--load", metavar=("NAME", "FX", "FY", "FZ"), nargs=4, **SEVERAL, help=told)
    add("--until", type=positive, help="when the loads end [s] (a tenth of the run)")
    add("--gravity", metavar="G", type=number, nargs=3, help="acceleration [m/s²]")
    add("--damping", type=nonnegative, default=0.05, help="numerical damping ξ (0.05)")


def _of_run(parser: RankParser, example: Example | None) -> None:
    add = parser.add_argument_group("run").add_argument
    add("--out", type=Path, help="folder for results (out/NAME OF THE FILE)")
    if example is not None:
        add("--short", action="store_true", help="coarse, and for a short time")
    add("--describe", action="store_true", help="show what would be run, and stop")
    add("--modes", metavar="N", type=count, help="the lowest N modes, and no run")
    add("--static", action="store_true", help="equilibrium under loads, and no run")
    add("--dt", type=positive, help="time step [s] (a 400th of the run)")
    add("--t-end", type=positive, help="end of the run [s]")
    add("--tol", type=nonnegative, help="rigid below this rate [1/s] (found)")
    told = "length of observation [s], or auto (auto)"
    add("--window", type=_length, default="auto", help=told)
    add("--compare", action="store_true", help="run all flexible as well")


def _length(text: str) -> float | str:
    """A window of observation."""
    return text if text == "auto" else positive(text)


def _complete(options: Namespace, example: Example) -> None:
    """Fill missing options from the example: a block on a thin arm at a wall, pushed down."""
    if options.short:
        options.order = options.order or 1
    if not options.example:
        return
    options.file = example.file
    options.out = options.out or example.out
    options.size = options.size or (0.02 if options.short else 0.012)
    options.hold = options.hold or ["wall"]
    options.load = options.load or [["end", "0", "0", "-300"]]
    options.until = options.until or 0.004
    options.t_end = options.t_end or (0.044 if options.short else 0.2)
    options.dt = options.dt or (8e-4 if options.short else 5e-4)


def _pairs(parser: RankParser, option: str, texts: list[str]) -> dict[str, str]:
    """The values of an option NAME=VALUE, as a dict."""
    found: dict[str, str] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if not (name and value):
            parser.error(f"--{option}: '{text}' should be NAME=VALUE")
        if name in found:
            parser.error(f"--{option}: the name '{name}' is given twice")
        found[name] = value
    return found


def _three(parser: RankParser, option: str, texts: list[str]) -> np.ndarray:
    """The three numbers of an option, such as a total force [N]."""
    try:
        return np.array([number(text) for text in texts])
    except ArgumentTypeError as error:
        parser.error(f"--{option}: {error}")
