"""Strains and rates of e in rigid cells, beside finite differences of its field, on many ranks.

Argument: how many unknowns e is solved for, "0" for a solution by modes.
"""

from __future__ import annotations

import sys

import basix
import numpy as np
from error_on_ranks import DT, scene
from parallel import report

import rigidfx as rf
from rigidfx.error import error_motion
from rigidfx.error.error_motion import ErrorMotion

largest, begin = error_motion.LARGEST, ErrorMotion.__init__
error_motion.LARGEST = int(sys.argv[1])
every = []


def made(self, *arguments):
    begin(self, *arguments)
    every.append(self)


ErrorMotion.__init__ = made
points, weights = basix.make_quadrature(basix.CellType.hexahedron, 3)
element = scene.space.element.basix_element
table = element.tabulate(1, points)[1:, :, :, 0]
nodes = scene.space.dofmap.list[: scene.mesh.topology.index_map(3).size_local]
X = scene.space.tabulate_dof_coordinates()[nodes]
J = np.einsum("dqa,cai->cqid", table, X)
gradients = np.einsum("dqa,cqdi->cqai", table, np.linalg.inv(J))


def measured(motion, shape):
    """Root mean square of the linear strain by a motion of the owned nodes."""
    full = error._forms.shape.copy()
    full.x.array[: motion.size] = motion.reshape(-1)
    full.x.scatter_forward()
    de, u = (a.reshape(-1, 3)[nodes] for a in (full.x.array, shape))
    F = np.eye(3) + np.einsum("cai,cqaj->cqij", u, gradients)
    half = np.einsum("cqki,cqkj->cqij", F, np.einsum("cai,cqaj->cqij", de, gradients)) / 2
    strain = half + half.transpose(0, 1, 3, 2)
    return np.sqrt(np.einsum("cqij,cqij,q->c", strain, strain, weights) / weights.sum())


seen, before, last, worst = 0, None, 0, 0.0
rows = []
for r in rf.simulate(scene, DT, 4.0, rigidify=rf.StrainRate(2e-3, 20 * DT), progress=False):
    error = every[-1]
    cells = np.flatnonzero(r.state.body_numbers() > 0).astype(np.int32)
    now = None if error._response is None else error._response.fields()[0]
    if now is not None and before is not None and error.steps == last + 1:
        span, shape = error._dt, error._forms.shape.x.array
        rates, strains = error.rates(cells), error.strains(cells)
        own = measured(now - before, shape)[cells] / span, measured(now, shape)[cells]
        sizes = np.max(scene.comm.allgather([a.max(initial=0.0) for a in own]), axis=0)
        for told, true, size in zip((rates, strains), own, sizes, strict=True):
            off = np.abs(told - true).max(initial=0.0)
            worst = max(worst, off / size if size > 0 else 0.0)
        rows.append(scene.sum(np.array([float(rates @ rates), float(strains @ strains)])).tolist())
        seen += cells.size
    before, last = now, error.steps
ErrorMotion.__init__, error_motion.LARGEST = begin, largest  # ranks run other scripts, too
worst, seen = max(scene.comm.allgather(worst)), sum(scene.comm.allgather(seen))
if scene.comm.rank == 0:
    report({"worst": worst, "seen": seen, "rows": rows})
