"""Strains and rates of e in rigid cells, beside finite differences of its field, on many ranks.

Argument: how many unknowns e is solved for, "0" for a solution by modes.
"""

from __future__ import annotations

import sys

import basix
import numpy as np
from dolfinx import fem
from error_on_ranks import DT, scene
from parallel import report

import rigidfx as rf
from rigidfx.error import equations
from rigidfx.error.error_motion import ErrorMotion
from rigidfx.error.frames import Frames, to_shape

every, largest, begin = [], equations.LARGEST, ErrorMotion.__init__


def made(self, *arguments):
    begin(self, *arguments)
    every.append(self)


points, weights = basix.make_quadrature(basix.CellType.hexahedron, 3)
table = scene.space.element.basix_element.tabulate(1, points)[1:, :, :, 0]
nodes = scene.space.dofmap.list[: scene.mesh.topology.index_map(3).size_local]
X = scene.space.tabulate_dof_coordinates()
J = np.einsum("dqa,cai->cqid", table, X[nodes])
gradients = np.einsum("dqa,cqdi->cqai", table, np.linalg.inv(J))


def in_cells(vectors):
    """Vectors of the owned nodes at the nodes of each owned cell."""
    full = fem.Function(scene.space)
    full.x.array[: vectors.size] = vectors.reshape(-1)
    full.x.scatter_forward()
    return full.x.array.reshape(-1, 3)[nodes]


def measured(motion):
    """Root mean square of the linear strain by a motion of the owned nodes."""
    de, u = (in_cells(a) for a in (motion, frames.shape - X[: len(motion)]))
    F = np.eye(3) + np.einsum("cai,cqaj->cqij", u, gradients)
    half = np.einsum("cqki,cqkj->cqij", F, np.einsum("cai,cqaj->cqij", de, gradients)) / 2
    strain = half + half.transpose(0, 1, 3, 2)
    return np.sqrt(np.einsum("cqij,cqij,q->c", strain, strain, weights) / weights.sum())


frames, before, last, seen, worst, rows = None, None, (0, 0.0), 0, 0.0, []
ErrorMotion.__init__, equations.LARGEST = made, int(sys.argv[1])
run = rf.simulate(scene, DT, 2.4, rigidify=rf.StrainRate(2e-3, 20 * DT), progress=False)
for r in run:
    x, error = r.state.positions(np.arange(scene.owned_nodes)), every[-1]
    if frames is None and r.events:
        frames = Frames(scene, x)
    if error.steps == last[0]:
        continue
    shown, now = error.shown(), None  # none while modes do not tell e
    if shown is not None:
        now = to_shape(shown.displacement, frames.of_parts(x)[frames.part])
    cells = np.flatnonzero(r.state.body_numbers() > 0).astype(np.int32)
    told = error.rates(cells), error.strains(cells)  # rates by modes: since they were asked for
    if before is not None and now is not None:
        own = measured(now - before)[cells] / (r.t - last[1]), measured(now)[cells]
        for one, other in zip(told, own, strict=True):
            off = np.abs(one - other).max(initial=0.0), other.max(initial=0.0)
            off, size = np.max(scene.comm.allgather(off), axis=0)
            worst = max(worst, off / size if size > 0 else 0.0)
        rows.append(scene.sum([float(of @ of) for of in told]).tolist())
        seen += cells.size
    before, last = now, (error.steps, r.t)
ErrorMotion.__init__, equations.LARGEST = begin, largest  # ranks run other scripts, too
seen = sum(scene.comm.allgather(seen))
if scene.comm.rank == 0:
    report({"worst": float(worst), "seen": int(seen), "rows": rows})
