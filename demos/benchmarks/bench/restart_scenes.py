"""Runs that are killed again and again, and what they write."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

from common import boxes, comm

import rigidfx as rf

SOFT, STIFF = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e8))
EVERY = 25  # steps from one checkpoint to the next


def bouncing() -> tuple[rf.Scene, dict[str, Any]]:
    """A bar that is pulled, rests, and strikes a wall beside it: bodies freeze and are released."""
    box = rf.box((0, 0, 0), (8, 1, 1), (16, 1, 1))
    box = box.with_cells("stalk", lambda x: x[0] <= 2 + 1e-9)
    box = box.with_cells("block", lambda x: x[0] >= 2 - 1e-9)
    pulls = rf.Table([0, 1, 1.2, 1.6, 1.8, 4.4, 4.6, 5, 5.2], [0.0, 0, 60, 60, 0, 0, 60, 60, 0])
    wall = rf.Contact("z1", against=rf.Plane((0, 0, 1.004), (0, 0, -1)), stiffness=1e6)
    pull = rf.Traction("x1", (0, 0, 1.0), time=pulls)
    effects = [rf.Fixed("x0"), pull, wall, rf.MassDamping(4.0)]
    scene = rf.Scene(box, {"stalk": SOFT, "block": STIFF}, effects, probes={"tip": (8, 0.5, 0.5)})
    return scene, {"dt": 0.02, "t_end": 8.0, "rigidify": rf.StrainRate(1e-4, 0.3)}


def linked() -> tuple[rf.Scene, dict[str, Any]]:
    """Two bars with a spring in the hinge between them; they swing and are struck twice."""
    sizes = ((0, 0, 0), (1, 0.2, 0.2)), ((1.02, 0, 0), (2.02, 0.2, 0.2))
    box = boxes(*((*ends, (5, 1, 1)) for ends in sizes))
    for name, side in (("left", 1), ("right", -1)):
        box = box.with_cells(name, lambda x, s=side: s * x[0] < s * 1.01)
        box = box.with_facets(
            f"{name} end", lambda x, s=side: (s * x[0] < s * 1.01) & (abs(x[0] - 1.01) < 0.22)
        )
    box = box.with_facets("tip", lambda x: x[0] > 2.02 - 1e-9)
    box = box.with_vertices("axis", lambda x: (abs(x[0]) < 1e-9) & (abs(x[2]) < 1e-9))
    sides = rf.MeanFace("left end"), rf.MeanFace("right end")
    pin = rf.Revolute(*sides, (1.01, 0.1, 0.1), (0, 1, 0), name="pin")
    spring = rf.JointSpring("pin", stiffness=2.0, damping=0.05)
    blows = rf.Table([0, 0.8, 0.82, 0.84, 1.6, 1.62, 1.64], [0.0, 0, 1, 0, 0, 1, 0])
    push = rf.Traction("tip", (0, 0, 1e3), time=blows)
    damping = rf.StiffnessDamping(ratio=0.2, frequency=60.0)
    effects = [rf.Fixed("axis"), rf.Gravity((0, 0, -9.81)), pin, spring, push, damping]
    scene = rf.Scene(box, STIFF, effects, probes={"tip": (2.02, 0.1, 0.1)})
    return scene, {"dt": 0.004, "t_end": 2.4, "rigidify": rf.StrainRate(1e-3, 0.1)}


SCENES: dict[str, Callable[[], tuple[rf.Scene, dict[str, Any]]]] = {
    "contact": bouncing,
    "joints": linked,
}


def go_on(case: str, folder: Path, part: float) -> None:
    """Begin a run, or go on with it, until it is over.

    A file tells that it moves, and at the end another one how long it did so [s].
    """
    scene, call = SCENES[case]()
    again = any(folder.glob("checkpoint-*.rfx"))
    if again:
        steps = rf.resume(folder, scene)
    else:
        call["t_end"] *= part
        steps = rf.simulate(scene, checkpoint=rf.Checkpoint(folder, steps=EVERY), **call)
    began = 0.0
    with rf.Recorder(scene, folder, every=100, stress=False) as recorder:
        for report in steps:
            recorder.write(report)
            began = began or perf_counter()
            if report.step % EVERY == 1:
                (folder / f"moves-{os.getpid()}").touch()
    if comm.rank == 0:
        (folder / "over").write_text(str(perf_counter() - began), encoding="utf-8")
