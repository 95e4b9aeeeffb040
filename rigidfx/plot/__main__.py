"""The standard pictures of a run: python3 -m rigidfx.plot FOLDER."""

import argparse
import sys
from pathlib import Path

from mpi4py import MPI

from rigidfx.base.errors import RigidfxError
from rigidfx.plot.pictures import FRAMES, pictures
from rigidfx.plot.renders import VIEW
from rigidfx.plot.web import web


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
    for name, default in (("view", VIEW), ("up", (0.0, 0.0, 1.0))):
        text = f"{name} of the camera ({' '.join(f'{x:g}' for x in default)})"
        parser.add_argument(f"--{name}", type=float, nargs=3, default=default, help=text)
    text = f"of the film, or of motion.html, at most ({FRAMES})"
    parser.add_argument("--frames", type=int, default=FRAMES, help=text)
    text = "factor of displacements, or auto: the largest is a tenth of the body (1)"
    parser.add_argument("--scale", type=_scale, default=1.0, help=text)
    text = "write motion.html instead: the motion in 3D, for a browser"
    parser.add_argument("--web", action="store_true", help=text)
    options = parser.parse_args()
    how = {k: value for k, value in vars(options).items() if k not in ("folder", "web")}
    first = MPI.COMM_WORLD.rank == 0
    try:
        folder = options.folder
        made = [web(folder, **how)] if options.web else pictures(folder, **how)
    except RigidfxError as error:  # on all ranks
        parser.exit(1, f"{parser.prog}: {error}\n" if first else None)
    if first:
        sys.stdout.writelines(f"{path}\n" for path in made)


if __name__ == "__main__":
    main()
