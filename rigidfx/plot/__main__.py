"""The standard pictures of a run: python3 -m rigidfx.plot FOLDER."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mpi4py import MPI

from rigidfx.base.errors import RigidfxError
from rigidfx.plot.pictures import pictures

__all__ = ["main"]


def _scale(text: str) -> float | str:
    """A number, or "auto"."""
    try:
        return text if text == "auto" else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be a number or auto, got '{text}'") from None


def main() -> None:
    """Draw the pictures that the command line asks for, and print their files. Collective."""
    parser = argparse.ArgumentParser(
        prog="python3 -m rigidfx.plot", description="Standard pictures of a run, in its folder."
    )
    parser.add_argument("folder", type=Path, help="what a Recorder has written")
    for name, default in (("view", (1.0, -0.6, 0.5)), ("up", (0.0, 0.0, 1.0))):
        text = f"{name} of the camera ({' '.join(f'{x:g}' for x in default)})"
        parser.add_argument(f"--{name}", type=float, nargs=3, default=default, help=text)
    parser.add_argument("--frames", type=int, default=100, help="of the film at most (100)")
    text = "factor of displacements, or auto: the largest is a tenth of the body (1)"
    parser.add_argument("--scale", type=_scale, default=1.0, help=text)
    options = parser.parse_args()
    how = {name: value for name, value in vars(options).items() if name != "folder"}
    first = MPI.COMM_WORLD.rank == 0
    try:
        made = pictures(options.folder, **how)
    except RigidfxError as error:  # on all ranks
        parser.exit(1, f"{parser.prog}: {error}\n" if first else None)
    if first:
        sys.stdout.writelines(f"{path}\n" for path in made)


if __name__ == "__main__":
    main()
