"""Code of a user's own that fails, or gives no numbers, in the middle of a run.

All of it is asked on each rank about that rank's nodes and cells.
"""

from dataclasses import dataclass
from functools import cache
from traceback import format_exception
from typing import Any, ClassVar

import numpy as np
import pytest
import refusals
from mpi4py import MPI

import rigidfx as rf
from rigidfx.decide.rules import RateRule
from rigidfx.decide.settings import Criterion
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
        return self._failing("rule", RateRule(scene, memory, 1e-3, self.window, {}))

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


ALONE = refusals.table("""
_contact(in_gap=Fault(3)) :: Contact on 'z0': its gap of the Floor failed with KeyError: 'no file'
_contact(in_gap=Fault(30)) :: Contact on 'z0': its gap of the Floor failed with KeyError: 'no file'
_contact(rf.Rigid("a"), in_gap=Fault(40)) :: its gap of the Floor failed with KeyError: 'no file'
_contact(in_gap=Fault(30, _nothing)) :: gap of the Floor must give finite numbers of shape (
_contact(in_gap=Fault(30, lambda g: g[1:])) :: gap of the Floor must give finite numbers of shape (
_contact(in_outward=Fault(1)) :: Contact on 'z0': its outward of the Floor failed
_contact(in_approach=Fault(2)) :: Contact on 'z0': its approach of the Floor fail
_contact(in_approach=Fault(2, lambda a: None)) :: approach of the Floor must give an Approach, got N
_own("load") :: Own on 'all cells': its load failed with KeyError: 'no file'
_own("resist") :: Own on 'all cells': its resist failed with KeyError: 'no file'
_own("stiffen") :: Own on 'all cells': its stiffen failed with KeyError: 'no file'
_own("stored") :: Own on 'all cells': its stored failed with KeyError: 'no file'
_own("accept", 2) :: Own on 'all cells': its accept failed with KeyError: 'no file'
_own("stored", 3, lambda good: "high") :: Own on 'all cells': stored must be a finite number, got 'h
""")
# What fails where ranks meet; other failures on some ranks end all: see `test_uncaught`.
CASES = refusals.table("""
_own("bind", 0) :: Own on 'all cells': its bind failed with KeyError: 'no file'
_own("bind", 0, lambda good: 3.0) :: Own on 'all cells': its bind failed with TypeError: 3.0 is no A
_own("load", 2, lambda good: np.nan) :: Own on 'all cells': its load gave a force of nan N.
_own("resist", 3, lambda good: np.nan) :: Own on 'all cells': its resist gave a force of nan N.
_own("resist", 3, lambda good: np.nan, of_bodies=True) :: Own on 'all cells': its resist gave a forc
_asking("rule", 0) :: Asking: its rule failed with KeyError: 'no file'
_asking("indicator", 0) :: Asking: its indicator failed with KeyError: 'no file'
""")
CRITERIA = (
    '_run(steps=32, rigidify=Asking("limits", Fault()))',
    '_asking("tol", 0)',
    '_asking("observe")',
    '_asking("length")',
    '_asking("measure")',
    '_asking("length", 7)',
)


def action(expression):
    return lambda: eval(expression, globals())


@pytest.mark.parametrize("case", ALONE | CASES)
def test_is_told(case):
    """By an error of this package, which names the thing, the time and the error."""
    refusals.check(action(case), (ALONE | CASES)[case])


@pytest.mark.parametrize("case", CRITERIA)
def test_of_a_criterion_ends_the_run(case):
    with pytest.raises(KeyError, match="no file"):
        action(case)()


@pytest.mark.parallel
def test_is_told_on_two_ranks():
    """Where it fails on the last of them: the same message on both, and no rank waits."""
    refusals.check_on_two_ranks(__file__, CASES)


def test_the_traceback_is_shown():
    """It names the line of the user's that has failed."""
    with pytest.raises(rf.SceneError) as told:
        _own("stored")
    assert 'return {}["no file"] if self.bad is None' in "".join(format_exception(told.value))


if __name__ == "__main__":
    refusals.on_each_rank({case: action(case) for case in CASES})
