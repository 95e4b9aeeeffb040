"""Code of a user's own that fails, or gives no numbers, in the middle of a run.

All of it is asked on each rank about that rank's nodes and cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from traceback import format_exception
from typing import Any, ClassVar

import numpy as np
import pytest
import refusals
from mpi4py import MPI

import rigidfx as rf
from rigidfx.decide.criteria.criterion import ErrorRule, Tolerances
from rigidfx.decide.criteria.judging import Criterion
from rigidfx.effects.action import Action
from rigidfx.effects.base import Effect
from rigidfx.effects.contacts.obstacles import Approach, Obstacle
from rigidfx.flexible.strain_rate import StrainRates

COMM = MPI.COMM_WORLD
SOFT = rf.StVenantKirchhoff(E=1e5, nu=0.3, rho=1000.0)


class Fault:
    """Gives what it is given, but from some call on, on the last rank."""

    def __init__(self, after=0, bad=None):
        self.calls, self.after, self.bad = 0, after, bad

    def __call__(self, good):
        self.calls += 1
        if self.calls <= self.after or COMM.rank < COMM.size - 1:
            return good
        return {}["no file"] if self.bad is None else self.bad(good)


def _same(good):
    return good


@dataclass(frozen=True)
class Floor(Obstacle):
    """All below z = 0."""

    in_gap: Any = _same
    in_outward: Any = _same
    in_approach: Any = _same

    def gap(self, y):
        return self.in_gap(y[:, 2])

    def outward(self, y):
        return self.in_outward(np.broadcast_to([0.0, 0.0, 1.0], y.shape))

    def approach(self, y0, y1):
        up = np.broadcast_to([0.0, 0.0, 1.0], y0.shape)
        return self.in_approach(Approach(up, None, up))


@dataclass(frozen=True)
class Own(Effect):
    """Does nothing, until one of its methods fails."""

    is_lasting: ClassVar[bool] = True
    method: str
    fault: Any
    of_bodies: bool = False  # whether forces on bodies alone are no numbers

    def bind(self, structure):
        if self.method == "bind":
            return self.fault(None)

        def failing(action, *given):
            found = self.fault(0.0 if self.method == "stored" else None)
            if self.method in ("load", "resist") and found is not None:
                for part in given[-1].parts[self.of_bodies :]:
                    part[...] = found
            return found

        return type("OwnAction", (Action,), {self.method: failing, "kind": "Own"})()


@dataclass(frozen=True)
class Asking(Criterion):
    """Strain rates, until something of it fails."""

    method: str
    fault: Any
    wake: Any = "local"
    window: float = 0.02

    def _failing(self, kind, given):
        if self.method == kind:
            return self.fault(given)
        if hasattr(given, self.method):
            function = getattr(given, self.method)
            if callable(function):
                setattr(given, self.method, lambda *a: self.fault(function(*a)))
            else:
                own = property(lambda rule: self.fault(np.zeros_like(function)))
                given.__class__ = type("Own", (type(given),), {self.method: own})
        return given

    def rule(self, scene, timeline, memory):
        tolerances = Tolerances(scene, memory, 1e-3, {})
        return self._failing("rule", ErrorRule(timeline, memory, tolerances, self.window, 2.0))

    def indicator(self, scene, forces):
        return self._failing("indicator", StrainRates(scene, forces, "rms"))


@cache
def _box():
    box = rf.box((0, 0, 0.01), (4, 1, 1.01), (4, 1, 1))
    return box.with_cells("a", lambda x: x[0] < 1.0 + 1e-9)


def _run(*effects, steps=8, **options):
    falling = rf.InitialVelocity(linear=(0.1, 0.0, -1.0), angular=(0.0, 0.1, 0.0))
    scene = rf.Scene(_box(), SOFT, [falling, *effects])
    return list(rf.simulate(scene, 0.005, 0.005 * steps, **options))


def _contact(*effects, **faults):
    return _run(rf.Contact("z0", against=Floor(**faults), title="floor"), *effects)


def _own(method, after=3, bad=None, of_bodies=False):
    return _run(Own(method, Fault(after, bad), of_bodies), rf.Rigid("a"), steps=4)


def _asking(method, after=2, *effects):
    return _run(*effects, rigidify=Asking(method, Fault(after)))


def _nothing(good):
    return good * np.nan


KEY = "with KeyError: 'no file'"
FLOOR, OWN = "Contact on 'z0': ", "Own on 'all cells': "
CASES = {
    "gap in a first step": (
        lambda: _contact(in_gap=Fault(3)),
        f"{FLOOR}its gap of the Floor failed {KEY}",
    ),
    "gap later": (lambda: _contact(in_gap=Fault(30)), f"{FLOOR}its gap of the Floor failed {KEY}"),
    "gap at a body": (
        lambda: _contact(rf.Rigid("a"), in_gap=Fault(40)),
        f"{FLOOR}its gap of the Floor failed {KEY}",
    ),
    "gap that ceases": (
        lambda: _contact(in_gap=Fault(30, _nothing)),
        f"{FLOOR}gap of the Floor must give finite numbers of shape (",
    ),
    "gap of fewer points": (
        lambda: _contact(in_gap=Fault(30, lambda g: g[1:])),
        f"{FLOOR}gap of the Floor must give finite numbers of shape (",
    ),
    "outward": (lambda: _contact(in_outward=Fault(1)), f"{FLOOR}its outward of the Floor failed"),
    "approach": (lambda: _contact(in_approach=Fault(2)), f"{FLOOR}its approach of the Floor fail"),
    "approach that is none": (
        lambda: _contact(in_approach=Fault(2, lambda a: None)),
        f"{FLOOR}approach of the Floor must give an Approach, got None.",
    ),
    "bind": (lambda: _own("bind", 0), f"{OWN}its bind failed {KEY}"),
    "bind to no action": (
        lambda: _own("bind", 0, lambda good: 3.0),
        f"{OWN}its bind failed with TypeError: 3.0 is no Action",
    ),
    "loads": (lambda: _own("load"), f"{OWN}its load failed {KEY}"),
    "resistance": (lambda: _own("resist"), f"{OWN}its resist failed {KEY}"),
    "tangent": (lambda: _own("stiffen"), f"{OWN}its stiffen failed {KEY}"),
    "energy": (lambda: _own("stored"), f"{OWN}its stored failed {KEY}"),
    "acceptance": (lambda: _own("accept", 2), f"{OWN}its accept failed {KEY}"),
    "loads that are no numbers": (
        lambda: _own("load", 2, lambda good: np.nan),
        f"{OWN}its load gave a force of nan N.",
    ),
    "resistance that is no number": (
        lambda: _own("resist", 3, lambda good: np.nan),
        f"{OWN}its resist gave a force of nan N.",
    ),
    "resistance of bodies that is no number": (
        lambda: _own("resist", 3, lambda good: np.nan, of_bodies=True),
        f"{OWN}its resist gave a force of nan N.",
    ),
    "energy that is no number": (
        lambda: _own("stored", 3, lambda good: "high"),
        f"{OWN}stored must be a finite number, got 'high'",
    ),
    "rule": (lambda: _asking("rule", 0), f"Asking: its rule failed {KEY}"),
    "indicator": (lambda: _asking("indicator", 0), f"Asking: its indicator failed {KEY}"),
}
CRITERIA = {
    "limits": lambda: _run(steps=32, rigidify=Asking("limits", Fault())),
    "tolerances": lambda: _asking("tol", 0),
    "memory of a rule": lambda: _asking("observe"),
    "length of windows": lambda: _asking("length"),
    "measure": lambda: _asking("measure"),
    "measure after the last step": lambda: _asking("length", 7),
}
# What fails where ranks meet; other failures on some ranks end all: see `test_uncaught`.
TOLD = [
    "bind", "bind to no action", "loads that are no numbers", "resistance that is no number",
    "resistance of bodies that is no number", "rule", "indicator",
]  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_is_told(name):
    """By an error of this package, which names the thing, the time and the error."""
    refusals.check(*CASES[name], rf.SceneError)


@pytest.mark.parametrize("name", CRITERIA)
def test_of_a_criterion_ends_the_run(name):
    with pytest.raises(KeyError, match="no file"):
        CRITERIA[name]()


@pytest.mark.parallel
def test_is_told_on_two_ranks():
    """Where it fails on the last of them: the same message on both, and no rank waits."""
    found = dict(refusals.found_on_two_ranks(__file__))
    assert list(found) == TOLD
    for name in TOLD:
        assert CASES[name][1] in found[name][1], (name, found[name])


def test_the_traceback_is_shown():
    """It names the line of the user's that has failed."""
    with pytest.raises(rf.SceneError) as told:
        _own("stored")
    assert 'return {}["no file"] if self.bad is None' in "".join(format_exception(told.value))


if __name__ == "__main__":
    refusals.on_each_rank({name: CASES[name][0] for name in TOLD})
