"""The standard pictures of a run: python3 -m rigidfx.plot FOLDER."""

from __future__ import annotations

import argparse
from pathlib import Path

from rigidfx.plot.pictures import pictures

__all__ = ["main"]


def _scale(text: str) -> float | str:
    """A number, or "auto"."""
    return text if text == "auto" else float(text)


def main() -> None:
    """Draw the pictures that the command line asks for."""
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
    pictures(
        options.folder,
        frames=options.frames,
        view=options.view,
        up=options.up,
        scale=options.scale,
    )


if __name__ == "__main__":
    main()
