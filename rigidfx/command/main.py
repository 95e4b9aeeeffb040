"""What the command does: reads a geometry, runs it with parts that become rigid, draws pictures.

The tolerance of the criterion is a strain rate, and its size depends on the motion. Unless it is
given, the time of the load is run once without rigid parts, and a fiftieth of the largest strain
rate is taken. A description, modes and statics are made in place of a run.

Errors and warnings name arguments and classes of Python, as they are written for scripts. Where the
command has an option, this stands in their place; a closing sentence names the others as those of
Python.
"""

import json
import re
import sys
import warnings
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from tqdm import tqdm

from rigidfx import effects
from rigidfx.base.errors import RigidfxError, RigidfxWarning, SceneError
from rigidfx.base.files import write_text
from rigidfx.base.types import TINY
from rigidfx.base.warning import worded
from rigidfx.command.largest import Largest
from rigidfx.command.options import CAD, GEO, Example, RankParser, ask, say
from rigidfx.command.pair import Pair
from rigidfx.decide.settings import StrainRate
from rigidfx.domain.cad import list_cad, read_cad
from rigidfx.domain.domain import Domain
from rigidfx.domain.gmsh_model import read_msh
from rigidfx.domain.gmsh_script import read_geo
from rigidfx.domain.inp import read_inp
from rigidfx.effects import Fixed, Gravity, NumericalDamping, Traction
from rigidfx.effects.base import Effect
from rigidfx.mechanics.materials import StVenantKirchhoff
from rigidfx.output.recorder import Recorder
from rigidfx.plot import Shapes, curves
from rigidfx.scene.scene import Scene
from rigidfx.simulation import simulate
from rigidfx.statics import static
from rigidfx.vibration.modes import modes, periods

QUIET = 0.02  # tolerance, relative to the largest strain rate under the load
PICTURES = 0.05, 0.35, 0.65, 1.0  # of the run's time, of the shapes that are drawn


def write_json(path: Path, content: Any, indent: int | None = 2) -> str:
    """Write numbers and names as JSON, and return them. Collective."""
    text = json.dumps(content, indent=indent, ensure_ascii=False) + "\n"
    write_text(MPI.COMM_WORLD, path, text)
    return text


def conclude(folder: Path, summary: Any) -> None:
    """Leave `summary.json` in a folder, and print it. Collective."""
    say(write_json(folder / "summary.json", summary).rstrip())


def is_at_rest(options: Namespace) -> bool:
    """Whether the options ask for something in place of a run."""
    return bool(options.describe or options.modes or options.static)


def at_rest(scene: Scene, options: Namespace) -> dict[str, Any]:
    """Print description, modes or statics, leave files; content of `summary.json`. Collective."""
    summary: dict[str, Any] = {"file": options.file.name}
    if options.describe:
        scene.describe(dt=options.dt, periods=3)
    if options.modes:
        found = modes(scene, options.modes)
        for number, frequency in enumerate(found.frequencies, start=1):
            say(f"mode {number}: {frequency:.6g} Hz")
        found.write(options.out)
        say("Pictures are being drawn ...")
        found.draw(options.out / "modes.png")
        summary["frequencies"] = found.frequencies.tolist()
    if options.static:
        largest = Largest(scene, [1.0])
        with Recorder(scene, options.out) as recorder:
            for report in static(scene):
                recorder.write(report)
                largest.add(report)
        say("\n".join(largest.lines(timed=False)))
        say("Pictures are being drawn ...")
        largest.shapes.draw(options.out / "stress.png", title=options.file.name, scale="auto")
        summary |= largest.numbers()
    if options.modes or options.static:
        write_json(options.out / "summary.json", summary)
        say(f"Pictures, fields and summary.json are in {options.out}")
    return summary


def read(parser: RankParser, options: Namespace) -> Domain:
    """The domain of the file, whose names are printed. Collective.

    The command ends here if it has only to show the file, or nothing is held or loaded: a free part
    has a description and modes, but no equilibrium and no run.
    """
    if options.list and options.kind in CAD:
        say(str(list_cad(options.file, scale=options.scale)))
        sys.exit(0)
    domain = _domain(options)
    cells = domain.mesh.topology.index_map(3).size_global
    x = np.concatenate(MPI.COMM_WORLD.allgather(domain.mesh.geometry.x))
    size = " × ".join(f"{extent:.4g}" for extent in np.ptp(x, axis=0))
    say(f"{options.file}: {cells} cells, {size} m; names: {domain.names}")
    nothing = not (options.hold or options.load or options.gravity)
    missing = "Say what is held and loaded: --hold NAME --load NAME FX FY FZ. See also --help."
    if nothing and (options.static or options.t_end is not None):
        parser.error(missing)
    if nothing and not is_at_rest(options):
        say(missing)
        sys.exit(0)
    if options.list:
        sys.exit(0)
    if options.t_end is None and not is_at_rest(options):
        parser.error("--t-end is missing: how long is the run [s]? Or take --static or --modes.")
    return domain


def _domain(options: Namespace) -> Domain:
    path, size, scale = options.file, options.size, options.scale
    curved, order = options.curved, 2 if options.curved else 1
    if options.kind in CAD:
        surfaces = {
            name: [int(n) if n.isdecimal() else n for n in numbers.split(",")]
            for name, numbers in options.surfaces.items()
        }
        per_circle = options.per_circle or 0.0
        return read_cad(
            path, surfaces=surfaces, size=size, scale=scale, per_circle=per_circle, order=order
        )
    if options.kind in GEO:
        parameters = {name: _value(text) for name, text in options.parameters.items()}
        return read_geo(path, parameters, size=size, scale=scale, order=order if curved else None)
    if options.kind == ".inp":
        corners, encoding = options.corners, options.encoding
        return read_inp(path, scale=scale, corners=corners, encoding=encoding)
    return read_msh(path, scale=scale)


def _value(text: str) -> float | str:
    """A number if it is one."""
    try:
        return float(text)
    except ValueError:
        return text


def supports_and_loads(options: Namespace) -> list[Effect]:
    """The effects that the options name.

    A load is a total force over the area of its facets.
    """
    found: list[Effect] = [NumericalDamping(options.damping)] if options.damping else []
    for text in options.hold:
        name, _, components = text.partition(":")
        found.append(Fixed(name, components or "xyz"))
    for name, force in options.load:
        found.append(Traction(name, tuple(force), total=True, until=options.until))
    if options.gravity:
        found.append(Gravity(tuple(options.gravity)))
    return found


def main(prog: str | None = None, example: Example | None = None) -> dict[str, Any]:
    """Run the command with its options, or an example where no file is given. Collective.

    It returns the content of `summary.json`.
    """
    parser, options = ask(prog, example)
    found = options.tol is None
    with told(parser):
        scene = _scene(read(parser, options), options)
        if is_at_rest(options):
            return at_rest(scene, options)
        dt = options.dt
        times = options.t_end * np.array(PICTURES)
        shapes, largest = Shapes(scene, times, colour="rigid"), Largest(scene, times)
        _tell_of_times(scene, dt, options)
        recorder = Recorder(scene, options.out, interval=options.t_end / 100)
        with recorder, _pair(scene, dt, options) as run:
            for report in run:
                recorder.write(report)
                shapes.add(report)
                largest.add(report)
        summary = _summary(run, options) | {"dt": dt, "tol_found": found}
        summary |= largest.numbers()
        write_json(options.out / "summary.json", summary)
        say("\n".join(largest.lines()))
        say("Pictures are being drawn ...")
        _draw(run, options)
        look: dict[str, Any] = {
            "title": options.file.name,
            "view": (0.7, -1.0, 0.45),
            "scale": "auto",
        }
        shapes.draw(options.out / "rigid_parts.png", **look)
        largest.shapes.draw(options.out / "stress.png", columns=len(times) + 1, **look)
    say(f"Pictures, fields and summary.json are in {options.out}")
    return summary


def run() -> None:
    """The installed command. Collective."""
    main("rigidfx")


def _scene(domain: Domain, options: Namespace) -> Scene:
    """The geometry with its materials and effects; second-order cells have a consistent mass."""
    return Scene(
        domain,
        materials(options),
        supports_and_loads(options),
        order=options.order,
        element=options.element,
        mass="consistent" if options.order == 2 else "lumped",
    )


def materials(options: Namespace) -> StVenantKirchhoff | dict[str, StVenantKirchhoff]:
    """One for all, or one for each name."""
    if not options.material:
        return StVenantKirchhoff(E=options.E, nu=options.nu, rho=options.rho)
    return {
        name: StVenantKirchhoff(E=float(E), nu=float(nu), rho=float(rho))
        for name, (E, nu, rho) in options.material.items()
    }


def _tell_of_times(scene: Scene, dt: float, options: Namespace) -> None:
    """Until when loads act, and the longest periods with their steps. Collective."""
    if options.load:
        say(f"loads act until t = {options.until:.4g} s (--until)")
    for period in periods(scene):
        say(f"period {period:.4g} s: {period / dt:.3g} steps of {dt:.4g} s (--dt)")


def _pair(scene: Scene, dt: float, options: Namespace) -> Pair:
    """The run, and the one beside it that --compare asks for."""
    if options.tol is None:
        options.tol = QUIET * _largest_rate(scene, dt, options)
    since = options.until if options.load else 0.0  # s; observation begins
    criterion = StrainRate(options.tol, options.window, min_cells=10, since=since)
    say(
        f"Δt = {dt:g} s to t = {options.t_end:g} s on {scene.comm.size} rank(s), "
        f"tolerance {options.tol:.3g} 1/s"
    )
    return Pair(scene, dt, options.t_end, criterion, compare=options.compare)


def _largest_rate(scene: Scene, dt: float, options: Namespace) -> float:
    """Largest strain rate of any cell until the loads end [1/s]."""
    largest = 0.0
    watched = StrainRate(0.0, 2 * options.t_end)
    end = min(options.until, options.t_end)
    say(f"0 … {end:.4g} s are run all flexible first, to find the tolerance (--tol)")
    with warnings.catch_warnings():  # the run itself tells all that this one does
        warnings.simplefilter("ignore", RigidfxWarning)
        for r in simulate(scene, dt, end, rigidify=watched, progress=True):
            if r.strain_rate is not None:
                largest = max(largest, float(r.strain_rate.max(initial=0.0)))
    return scene.comm.allreduce(largest, op=MPI.MAX)


def _summary(run: Pair, options: Namespace) -> dict[str, Any]:
    """Numbers of the run, as JSON takes them."""
    reports, flexible = run.adaptive, run.flexible
    largest = max(*(r.energy for r in reports), TINY)  # J
    deviation = abs(reports[-1].energy - flexible[-1].energy) / largest if flexible else None
    return {
        "file": options.file.name,
        **run.summary(),
        "bodies_end": len(reports[-1].bodies),
        "energy_deviation": deviation,
        "tol": options.tol,
        "window": options.window,
        "order": options.order,
    }


def _draw(run: Pair, options: Namespace) -> None:
    """Energy and size of the problem against time."""
    drawn = ("Total energy", "energy"), ("Kinetic energy", "kinetic"), ("Unknowns", "unknowns")
    curves(
        {heading: run.curves(name) for heading, name in drawn},
        options.out / "energy_unknowns.png",
        xlabel="time (s)",
        ylabel=["energy (J)", "energy (J)", "number"],
        title=f"{options.file.name}: energy and size of the problem",
    )


# Patterns, in order, and the command's words. A name that a user has given stands in quotes, and
# stays; patterns with quotes of their own come first.
WORDS = (
    (r"order=2 with mass='consistent'", "--order 2"),
    (r"mass='consistent', or order=2 with hexahedra", "--order 2"),
    (r"\(size; in read_cad also per_circle=(\d+)", r"(--size; of CAD also --per-circle \1"),
    (r"read_inp\(…, (\w+)=('?)([\w-]+)\2\)", r"\1=\2\3\2"),
    (r"\bcorners=True", "--corners"),
    (r"\bencoding='([\w-]+)'", r"--encoding \1"),
    (r"\belement='(\w+)'", r"--element \1"),
    (r"\bcurved ones \(order=2\)", "curved ones (--curved)"),
    (r"\border=(\d)", r"--order \1"),
    (r"\bper_circle=(\d+)", r"--per-circle \1"),
    (r"glue=True of read_cad, ", ""),  # the command glues
    (r"\bscale=([\d.e-]+) where a mesh is read", r"--scale \1"),
    (r"\((size|scale)\)", r"(--\1)"),
    (r"since, until, the times of its Table, and t_end", "--until and --t-end"),
    (r"a larger tol\b", "a larger --tol"),
    (r"a (smaller|larger) tolerance", r"a \1 --tol"),
    (r"a longer window", "a longer --window"),
    (r"Take window ≥ ([\d.e-]+), or 'auto'", r"Take --window \1, or auto"),
    (r"\(rf\.periods\)", "(--describe)"),
    (r"\bScene\.describe\(\)", "--describe"),
    (r"\brf\.static\b", "--static"),
    (r"\bt_end\b", "--t-end"),
    (r"\bdt\b(?= [=≥≤]|\.)", "--dt"),
    (r"\bΔt(?=,? ≤| and|\.)", "Δt (--dt)"),
    (r"^Recorder:", "--out:"),
    (r"^StrainRate: (tol|window)\b", r"--\1"),
    (r"\bNumericalDamping\b", "--damping"),
    (r"\bTraction\b", "--load"),
    (r"\bFixed\b", "--hold"),
    (r"\bGravity\b", "--gravity"),
)
QUOTED = r"(?<!\w)('[^'\n]*')(?!\w)"
FUNCTIONS = "read_cad|read_geo|read_inp|read_msh|simulate|static|modes"
OWNER = re.compile(rf"^(?:gmsh: )?(?:{FUNCTIONS}|[A-Z]\w+): ")
EFFECTS = (name for name in vars(effects) if name != name.lower())
CLASSES = "|".join([*EFFECTS, "Accuracy", "NeoHooke", "Release", "StepControl"])
OTHERS = re.compile(
    rf"\brf\.\w+|\b(?:{CLASSES})\b|\bwith_\w+|\b[a-z]\w*=(?!=)|\((?:never|patience|leave_out\?)\)"
)


def in_options(message: str) -> str:
    """A message of Python's words in the words of the command."""
    message, *table = message.split("\n", 1)  # of what there is, in words of its own
    for pattern, words in WORDS:
        if "'" in pattern:
            message = re.sub(pattern, words, message)
    parts = re.split(QUOTED, message)
    own = parts[::2]  # what stands between names
    for pattern, words in WORDS:
        whole = own[:1] if pattern.startswith("^") else own
        own[: len(whole)] = [re.sub(pattern, words, part) for part in whole]
    own[0] = OWNER.sub("", own[0])
    others = [found.strip("()=?") for part in own for found in OTHERS.findall(part)]
    parts[::2] = own
    text = "".join(parts)
    if others:
        text += f" (Only scripts in Python have {', '.join(dict.fromkeys(others))}.)"
    return "\n".join([text, *table])


@contextmanager
def told(parser: RankParser) -> Iterator[None]:
    """Stop all ranks over an error of rigidfx, which all have: a message instead of a traceback.

    Warnings are lines, without the place in a script that Python shows. Both name options.
    """
    try:
        with worded(in_options), _in_lines():
            yield
    except SceneError as error:  # of what is asked for
        parser.error(in_options(str(error)))
    except RigidfxError as error:  # of the run
        parser.exit(1, f"{parser.prog}: {type(error).__name__}: {in_options(str(error))}\n")


@contextmanager
def _in_lines() -> Iterator[None]:
    """Show warnings of rigidfx as lines, above a bar of progress."""
    before = warnings.showwarning

    def show(message: Any, category: type[Warning], *place: Any, **how: Any) -> None:
        if issubclass(category, RigidfxWarning):
            tqdm.write(f"rigidfx: warning: {in_options(str(message))}", file=sys.stderr)
        else:
            before(message, category, *place, **how)

    warnings.showwarning = show
    try:
        yield
    finally:
        warnings.showwarning = before
