"""When two times are the same instant, and two lengths of steps the same length.

Ends of steps are sums, breakpoints and due times are numbers that users write: they meet but for
rounding, and far closer than steps follow each other.
"""

from typing import Any

import numpy as np

CLOSE = 1e-9  # of a step, or of a length: what is nearer is the same
NUMBERS = 4  # ... or so many numbers apart, late in a run of small steps
CUT = 1e3  # more than the largest ratio of a step to what is left of it after cuts


def resolution(t: Any, dt: Any) -> Any:
    """How far apart times near t [s] are the same instant, in steps of dt [s]; arrays likewise."""
    return np.maximum(CLOSE * dt, NUMBERS * np.spacing(np.abs(t)))


def at_latest(t: Any, dt: Any) -> Any:
    """The latest time that is the same instant as the end t [s] of a step of dt [s], maybe cut."""
    return t + resolution(t, CUT * dt)


def reached(t: Any, due: float, dt: Any) -> Any:
    """Whether steps of dt [s], maybe cut, that end at t [s] have reached an instant [s]."""
    return at_latest(t, dt) >= due


def longer(a: Any, b: Any) -> Any:
    """Whether a length of time or a count is beyond another but for rounding; arrays likewise."""
    return a > b * (1 + CLOSE)
