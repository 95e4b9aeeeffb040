"""A run that a test drives itself, step by step and switch by switch."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from rigidfx.decide.bodies import Decision, plan_bodies
from rigidfx.decide.clusters import NONE, CellGraph, find_clusters
from rigidfx.preparation import prepare
from rigidfx.run import Run
from rigidfx.scene.timeline import Timeline


@contextmanager
def prepared(scene, dt=0.1) -> Iterator[Run]:
    """A run that has made no step yet."""
    run, _ = prepare(scene, Timeline(dt, 1e3 * dt))
    with run:
        yield run


def step(run, dt):
    """Advance by dt."""
    state = run.stepper.state
    run.switch.follow_effects(dt)
    return run.stepper.accept(run.stepper.attempt(state.t + dt))


def regroup(run, rigid):
    """Freeze all cells as one body, or release all; what happened."""
    stepper = run.stepper
    graph = CellGraph(stepper.scene)
    cells = np.full(graph.owned, rigid)
    before = stepper.state.body_numbers().astype(np.int64)
    before[before == 0] = NONE
    clusters = find_clusters(graph, cells, np.full(graph.owned, NONE), ~cells)
    sizes = {body.number: body.size for body in stepper.state.bodies.of.records}
    bodies, number = plan_bodies(clusters, before, sizes, {}, 1, graph.comm)
    kind = "freeze" if rigid else "release"
    return run.switch.apply(Decision(kind, "test", bodies, frozenset(), number))
