"""What the look for facets takes of a step, of two blocks that are pressed together all over."""

from __future__ import annotations

import numpy as np
from common import boxes
from petsc4py import PETSc

import rigidfx as rf

from .blocks import SOFT


def share_of_search(short: bool) -> dict[str, float]:
    """Part of a flexible step of two surfaces, both ways, and of one skin that may meet itself."""
    both = rf.Contact("lower", against="upper"), rf.Contact("upper", against="lower")
    found = _share(7 if short else 16, *both)
    of_skin = _share(7 if short else 16, rf.Contact("skin", against="skin"))
    return {**found, "search_of_skin_by_step": of_skin["search_by_step"]}


def _share(n: int, *contacts: rf.Contact) -> dict[str, float]:
    domain = boxes(
        ((0, 0, 0), (0.2, 0.2, 0.2), (n, n, n)),
        ((0.003, 0.005, 0.2001), (0.203, 0.205, 0.4001), (n, n, n)),
    )
    domain = domain.with_facets("lower", lambda x: x[2] < 0.20005)
    domain = domain.with_facets("upper", lambda x: x[2] > 0.20005)
    domain = domain.with_facets("skin", lambda x: np.full(x.shape[1], True))

    def thrown(x: np.ndarray) -> np.ndarray:
        return np.where(x[2] > 0.20005, -0.3, 0.3) * np.array([[0.0], [0.0], [1.0]])

    scene = rf.Scene(domain, SOFT, [*contacts, rf.InitialVelocity(function=thrown)])
    PETSc.Log.begin()
    search, wall, begun, steps = PETSc.Log.Event("rigidfxSearch"), 0.0, 0.0, 0
    for r in rf.simulate(scene, 2e-4, 12 * 2e-4, progress=False):
        if r.step == 2:  # buffers and kernels are there
            begun = search.getPerfInfo()["time"]
        elif r.step > 2:
            wall, steps = wall + r.wall, steps + 1
    spent = search.getPerfInfo()["time"] - begun
    return {
        "search_by_step": spent / wall,
        "step_ms": 1e3 * wall / steps,
        "unknowns": r.unknowns,
        "touching": float(sum(touch.nodes for touch in r.touches.values())),
    }
