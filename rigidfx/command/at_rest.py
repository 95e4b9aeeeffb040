"""Description, modes and statics in place of a run."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from rigidfx.command.files import write_json
from rigidfx.command.largest import Largest
from rigidfx.command.parser import say
from rigidfx.output.recorder import Recorder
from rigidfx.scene.scene import Scene
from rigidfx.statics import static
from rigidfx.vibration.modes import modes

__all__ = ["at_rest", "is_at_rest"]


def is_at_rest(options: Namespace) -> bool:
    """Whether the options ask for something in place of a run."""
    return bool(options.describe or options.modes or options.static)


def at_rest(scene: Scene, options: Namespace) -> dict[str, Any]:
    """Print description, modes or statics, and leave their files. Collective.

    Returns:
        Content of `summary.json`.
    """
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
