"""When and where a run leaves checkpoints, as a user states it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import path_of, positive, whole

__all__ = ["Checkpoint"]


@dataclass(frozen=True)
class Checkpoint:
    """A run leaves checkpoints in a folder, from which `resume` goes on.

    One more is written at the end of the run, and after Ctrl-C or a SIGTERM: the run completes its
    step and ends. A second Ctrl-C ends it at once. The newest two are kept.

    Attributes:
        folder: Where they are; that of a `Recorder`, say. It is made if it does not exist.
        every: Wall time from one to the next [s] ...
        steps: ... or the number of steps, if given ...
        time: ... or the simulated time, if given [s].
    """

    folder: str | Path
    every: float = 60.0
    steps: int | None = None
    time: float | None = None

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            SceneError: If the folder is no path, an interval is not positive, or two are given.
        """
        folder = path_of("Checkpoint", "folder", self.folder)
        object.__setattr__(self, "folder", str(folder))
        positive("Checkpoint", "every", self.every)
        if self.steps is not None:
            whole("Checkpoint", "steps", self.steps, least=1)
        if self.time is not None:
            positive("Checkpoint", "time", self.time)
        if self.steps is not None and self.time is not None:
            raise SceneError("Checkpoint: steps and time are both given. Name one of them.")
