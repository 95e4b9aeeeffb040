"""Arrows of forces and moments at the joints of a run, in its pictures.

The longest arrow of each kind has the same length in all pictures of a sheet or a film, and the
others are in proportion to it. Arrows are drawn over the body, which would hide most of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.base.types import Array
from rigidfx.plot.curves import prefixed
from rigidfx.report.report import Report

KINDS = {"force": ("#d62728", "red", "N"), "moment": ("#1f77b4", "blue", "N m")}
LONGEST = 0.4  # length of the longest arrow, over the radius of the body
SMALL = 0.03  # length over that of the longest arrow, below which one is left out; and of largest
# moment over largest force and radius, or the inverse, below which all of a kind are
ON_TOP = -66000.0  # offset of depths, in the smallest there are, that is before any body


@dataclass(frozen=True)
class Arrows:
    """Forces and moments of joints at a time, on their second sides."""

    places: Array  # places of the joints in the picture, shape (joints, 3) [m]
    force: Array  # shape (joints, 3) [N]
    moment: Array  # shape (joints, 3) [N m]


def arrows_of(report: Report) -> Arrows | None:
    """Arrows at the joints of a report's scene; None before the first step, and without joints."""
    known = report.joints.values()
    if not known:
        return None
    names = "place", "force", "moment"
    return Arrows(*(np.array([getattr(joint, name) for joint in known]) for name in names))


def largest_of(several: Sequence[Arrows | None], radius: float) -> dict[str, float]:
    """The largest force [N] and moment [N m] of all; a kind that is next to nothing is left out."""
    known = [arrows for arrows in several if arrows is not None]
    top = {
        kind: max((float(_sizes(arrows, kind).max(initial=0.0)) for arrows in known), default=0.0)
        for kind in KINDS
    }
    force, moment = top["force"], top["moment"] / radius
    counts = {"force": force > SMALL * moment, "moment": moment > SMALL * force}
    return {kind: value for kind, value in top.items() if counts[kind] and value > 0.0}


def ends_of(arrows: Arrows, largest: Mapping[str, float], radius: float) -> Array:
    """The points of the arrows, shape (arrows, 3) [m]."""
    reach = LONGEST * radius
    ends = [arrows.places + reach / top * getattr(arrows, kind) for kind, top in largest.items()]
    return np.concatenate([np.empty((0, 3)), *ends])


def add_arrows(plotter: Any, arrows: Arrows, largest: Mapping[str, float], radius: float) -> None:
    """Draw arrows from the places of joints along their forces and moments."""
    import pyvista as pv

    for kind, top in largest.items():
        length = _sizes(arrows, kind) / top
        seen = length >= SMALL
        if not seen.any():
            continue
        cloud = pv.PolyData(np.asarray(arrows.places[seen], np.float64))
        cloud["along"], cloud["length"] = getattr(arrows, kind)[seen], length[seen]
        drawn = cloud.glyph(orient="along", scale="length", factor=LONGEST * radius)
        actor = plotter.add_mesh(drawn, color=KINDS[kind][0], ambient=0.5, diffuse=0.5)
        actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
        actor.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, ON_TOP)


def told(largest: Mapping[str, float]) -> str:
    """Colour and largest value of each kind of arrow, for a picture; empty if there are none."""
    out = []
    for kind, top in largest.items():
        _, colour, unit = KINDS[kind]
        factor, unit = prefixed(unit, top)
        out.append(f"{colour}: {kind}s of joints up to {factor * top:.3g} {unit}")
    return "; ".join(out)


def _sizes(arrows: Arrows, kind: str) -> Array:
    return np.asarray(np.linalg.norm(getattr(arrows, kind), axis=1))
