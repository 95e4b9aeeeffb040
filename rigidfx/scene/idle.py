"""Loads that can be computed and do nothing in a run: that is hardly meant."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx import effects as fx
from rigidfx.base.types import Array, Bools
from rigidfx.base.warning import warn
from rigidfx.effects.supports.support import FLAT

LOADS: tuple[Any, ...] = (fx.DeadLoad, fx.Pressure)  # whose forces are on nodes of a set


def warn_of_idle(scene: Any, t_end: float) -> None:
    """Warn of loads that do nothing, by their time or as supports hold their nodes. Collective.

    Args:
        scene: The problem.
        t_end: End of the run [s].
    """
    for effect in scene.named(fx.Windowed):
        if not effect.is_load or effect.is_support:
            continue
        first, last = effect.start, min(effect.until, t_end)
        if not first < last or _is_zero(effect, first, last):
            warn(
                scene.comm,
                f"{effect.owner}: it does nothing from 0 to {t_end:g} s, where the run is. Check "
                "since, until, the times of its Table, and t_end: all are in seconds.",
            )
        elif isinstance(effect, LOADS) and effect.where and _held(scene, effect, first, last):
            warn(
                scene.comm,
                f"{effect.owner}: supports hold all nodes that it acts on, so that it moves "
                "nothing and only adds to reactions. Name another set, or let supports hold fewer "
                "nodes or components.",
            )


def _is_zero(effect: Any, first: float, last: float) -> bool:
    """Whether the factor of a load is a table that is zero between two times [s]."""
    table = getattr(effect, "time", None)
    if not isinstance(table, fx.Table):
        return False
    return not any(table(t) for t in (first, last, *(t for t in table.times if first < t < last)))


def _held(scene: Any, load: Any, first: float, last: float) -> bool:
    """Whether supports hold all dofs that a load acts on between two times [s]. Collective."""
    n = scene.owned_nodes
    held = np.zeros((n, 3), dtype=bool)
    for support, nodes in scene.supports:
        if support.since <= first and last <= support.until:
            held[np.ix_(nodes[nodes < n], support.axes)] = True
    for rigid in scene.named(fx.Rigid):  # a part that a support holds moves with it
        if rigid.deforms:
            continue
        nodes = scene.nodes(rigid.where, rigid.kind) if rigid.where else np.arange(n)
        nodes = nodes[nodes < n]
        held[nodes] |= bool(scene.sum(held[nodes].any()) > 0)
    nodes = scene.nodes(load.where, load.kind)
    nodes = nodes[nodes < n]
    free = np.asarray(scene.sum((~held[nodes]).sum(axis=0)))
    along = _directions(scene, load, scene.start_places[nodes])
    return bool(along.any() and not free[along].any())


def _directions(scene: Any, load: Any, X: Array) -> Bools:
    """Components that a load has: those of its value, or the normal of an even face. Collective."""
    value = getattr(load, "value", None)
    if isinstance(load, fx.Pressure):
        ends = np.r_[X.max(axis=0, initial=-np.inf), -X.min(axis=0, initial=np.inf)]
        scene.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
        extent = ends[:3] + ends[3:]
        flat = extent <= FLAT * extent.max()
        return flat if flat.any() else ~flat
    return np.ones(3, dtype=bool) if callable(value) else np.asarray(value, dtype=bool)
