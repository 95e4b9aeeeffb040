"""How a demo starts, with its options and its folder, and how it ends."""

import argparse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.files import write_text
from rigidfx.command.options import RankParser, say
from rigidfx.command.pair import Pair
from rigidfx.plot import Shapes

ROOT = Path(__file__).resolve().parents[2]
comm = MPI.COMM_WORLD


class Parser(RankParser):
    """Options of a demo.

    Two are there always: --short, and --out with out/NAME OF THE SCRIPT for its default.
    """

    def __init__(self, script: str, description: str, short: str, **others: Any) -> None:
        """Make a parser for a script, its `__file__`, and say what is shorter under --short."""
        super().__init__(description=description, **others)
        self.add_argument("--short", action="store_true", help=short)
        folder = ROOT / "out" / Path(script).stem
        self.add_argument("--out", type=Path, default=folder, help="folder")

    def add_resume(self) -> None:
        """Have an option --resume, for a run that was cut."""
        self.add_argument("--resume", action="store_true", help="go on from the last checkpoint")

    def add_only(self, of: str) -> None:
        """Have an option --only, for some of what there is; see `chosen`."""
        self.add_argument("--only", default="", help=f"{of} whose names contain this")

    def read(self, **short: Any) -> argparse.Namespace:
        """The options as given; by name, the defaults of those that --short changes."""
        options = self.parse_args()
        if options.short:
            self.set_defaults(**short)
            options = self.parse_args()
        return options

    def defaults(self, options: argparse.Namespace, *names: str) -> bool:
        """Whether options have their defaults (of the short run, where it is one)."""
        return all(getattr(options, name) == self.get_default(name) for name in names)


def chosen(
    options: argparse.Namespace, names: Iterable[str], short: Sequence[str] = ()
) -> list[str]:
    """The names that --only asks for; without it all, or those of the short run."""
    if options.short and short and not options.only:
        return list(short)
    return [name for name in names if options.only in name]


def share_of(name: str | None, scene: rf.Scene, report: rf.Report) -> float:
    """Part of the cells of a set, of all if None, that are in rigid bodies. Collective."""
    owned = scene.mesh.topology.index_map(3).size_local
    cells = np.arange(owned) if name is None else scene.domain.find(name, (3,), "share").entities
    cells = cells[cells < owned]
    inside = np.count_nonzero(report.state.body_numbers()[cells] > 0)
    return float(scene.sum(float(inside)) / scene.sum(float(cells.size)))


def go(
    options: argparse.Namespace,
    scene: rf.Scene,
    dt: Any,
    t_end: float,
    rule: rf.StrainRate,
    *shapes: Shapes,
    record: Mapping[str, Any],
    compare: bool = True,
    **how: Any,
) -> Pair:
    """Run a scene to its end, its flexible twin beside it unless told otherwise. Collective.

    It is recorded in the folder of the options, as told; its shapes are collected. Other arguments
    are those of `Pair`.
    """
    say(f"To t = {t_end:.4g} s on {scene.comm.size} rank(s), tolerance {rule.tol:g} 1/s")
    how |= {"folder": options.out, "resume": options.resume}
    with (
        rf.Recorder(scene, options.out, **record) as recorder,
        Pair(scene, dt, t_end, rule, compare, **how) as run,
    ):
        for report in run:
            recorder.write(report)
            for own in shapes:
                own.add(report)
    return run


def draw(
    options: argparse.Namespace, shapes: Shapes, title: str, name: str = "rigid_parts", **how: Any
) -> None:
    """Draw shapes, if there are any: a run that was over has none to add. Collective."""
    path = options.out / f"{name}.png"
    if shapes.count:
        shapes.draw(path, title=title, **how)
    else:
        say(f"The run was over before: no shapes for {path}")


def write(path: Path, text: str) -> None:
    """Write a file, and its folder if need be; a failure is one of all ranks. Collective."""
    write_text(comm, path, text)
