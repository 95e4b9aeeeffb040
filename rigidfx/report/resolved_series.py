"""A force of successive steps without the part that alternates, by fourth differences.

Cells vibrate faster than Δt resolves, and forces λ of constraints on them with it, for ever. In
steps of one length

    λ* = λ - δ⁴λ/16,    δ⁴λₙ = λₙ₋₂ - 4 λₙ₋₁ + 6 λₙ - 4 λₙ₊₁ + λₙ₊₂,

has nothing of an alternating force and no lag. A vibration that moves on by θ in a step keeps
1 - sin⁴(θ/2), as with `rigidfx.step.system.resolved_forces`: 0.99 at ten steps a period. Beside
the ends of a series λ* = λ + δ²λ/4, and the outermost steps go on from there in a straight line.
λ* is taken where δ⁴λ changes its
sign in two of three steps, as it does at three steps a period and less, so that a single jump of a
smooth force stays as it is. Two later steps are needed: weights of earlier steps alone that have
neither a lag nor an alternating part, such as (3, 2, -1)/4, make a jump larger by a quarter.
"""

from __future__ import annotations

import numpy as np

from rigidfx.base.types import Array, Bools
from rigidfx.step.watches.alternation import FIRST
from rigidfx.step.watches.unresolved import WORTH_A_WARNING as NOTHING

__all__ = ["resolved", "resolved_part"]


def resolved_part(forces: Array) -> Array:
    """Forces without the part that alternates; all of them in less than eight steps.

    Args:
        forces: Of successive steps of one length, shape (steps, columns).
    """
    if len(forces) < 2 * FIRST:
        return forces
    rest, ends = np.diff(forces, 4, axis=0) / 2**4, np.diff(forces, 2, axis=0)[[0, -1]] / 2**2
    turns = np.cumsum(rest[1:] * rest[:-1] < 0, axis=0)
    turns = np.concatenate([np.zeros_like(turns[:1]), turns])
    middle = np.clip(np.arange(len(forces)) - 2, 0, len(rest) - 1)
    begin = np.clip(middle - FIRST, 0, None)
    end = np.clip(middle + FIRST, None, len(rest) - 1)
    alternates = 3 * (turns[end] - turns[begin]) >= 2 * (end - begin)[:, None]
    inner = forces[1:-1] - np.concatenate([-ends[:1], rest, -ends[1:]])
    first, last = 2 * inner[:1] - inner[1:2], 2 * inner[-1:] - inner[-2:-1]
    return np.where(alternates, np.concatenate([first, inner, last]), forces)


def resolved(forces: Array, dt: Array, cut: Bools) -> Array:
    """Forces of all steps of a run without the part that alternates.

    Args:
        forces: Shape (steps, columns).
        dt: Lengths of the steps, shape (steps,) [s].
        cut: Whether something else acts from each step on, likewise.
    """
    longer = np.abs(np.diff(dt, prepend=dt[:1])) > NOTHING * dt
    at = np.flatnonzero(cut | longer)
    return np.concatenate([resolved_part(part) for part in np.split(forces, at)])
