"""Centre of a ball or a socket, from the facets of its surface.

The vertices lie on a sphere, |x - c|² = r², which is linear in c and in r² - |c|², and normals
point along x - c. The vertices of a hole between two rings do as well: their c is its middle.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.effects.joints.cylinder import ROUND, corners_of

__all__ = ["sphere_of"]

Array = npt.NDArray[np.float64]


def sphere_of(scene: Any, owner: str, where: str) -> Array | None:
    """Centre of a spherical surface, shape (3,) [m]; None if it is no sphere. Collective.

    Args:
        scene: The problem.
        owner: Who asks, for messages.
        where: Name of a set of boundary facets.
    """
    x = corners_of(scene, scene.boundary(where, owner))
    n = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    total = np.asarray(scene.sum(np.r_[x.sum(axis=(0, 1)), float(x[..., 0].size)]))
    middle = total[:3] / max(total[3], 1.0)  # a fit about a far origin would lose digits
    points = x.reshape(-1, 3) - middle
    rows = np.c_[2 * points, np.ones(len(points))]
    squares = (points**2).sum(axis=1)
    left, right = (np.asarray(scene.sum(v)) for v in (rows.T @ rows, rows.T @ squares))
    fitted = np.linalg.lstsq(left, right, rcond=None)[0]
    centre = fitted[:3]
    radius = float(np.sqrt(max(fitted[3] + centre @ centre, 0.0)))
    off = np.abs(np.linalg.norm(points - centre, axis=1) - radius).max(initial=0.0)
    out = (x - middle - centre).mean(axis=1)
    sizes = np.linalg.norm(n, axis=1) * np.linalg.norm(out, axis=1)
    along = np.abs((n * out).sum(axis=1))
    tilted = 1 - (along / np.where(sizes > 0, sizes, 1.0)).min(initial=1.0)
    worst, tilt = np.max(scene.comm.allgather((off, tilted)), axis=0)
    return middle + centre if worst <= ROUND * radius and tilt <= ROUND else None
