"""A structure that is run again and again, and the settings with which it is."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from hashlib import sha256

import numpy as np

import rigidfx as rf

from .setting import Setting

Points = Mapping[str, np.ndarray]  # name of a probe → its position [m]


@dataclass(frozen=True)
class Structure:
    """What is run again and again.

    Attributes:
        name: Its name.
        mesh: The domain, by the number of cells per edge of one of the base.
        scene: The problem on it.
        motion: What is compared, by the current positions of the probes [m].
        free: When the loads end [s].
        t_end: End of its runs [s].
        min_cells: Least size of a new body, in cells of the base mesh.
        at: Probe whose motion budgets are of.
        of: What they are parts of [m]: the largest bending, where most of a motion is rigid; the
            probe's largest displacement if None.
        settings: Label → setting; "reference" and "base" are among the labels.
    """

    name: str
    mesh: Callable[[int], rf.Domain]
    scene: Callable[[rf.Domain, Setting], rf.Scene]
    motion: Callable[[Points], float]
    free: float
    t_end: float
    min_cells: int
    at: str
    of: float | None
    settings: Mapping[str, Setting]

    @property
    def fingerprint(self) -> str:
        """Changes with the mesh and the scene, so that old runs are not taken for new ones."""
        mesh = self.mesh.func if isinstance(self.mesh, partial) else self.mesh
        sources = (inspect.getmodule(mesh), self.scene, self.motion)
        text = [*map(inspect.getsource, sources), repr(getattr(self.mesh, "keywords", {}))]
        return sha256("".join(text).encode()).hexdigest()[:16]
