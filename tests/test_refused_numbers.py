"""Each number of each record is refused by its name, of whatever kind that is no number it is."""

import datetime
import enum
import math

import numpy as np
import pytest
from records import RECORDS

import rigidfx as rf
from rigidfx.domain.domain import EntitySet
from rigidfx.plot import Curve

LOOP: list[object] = []
LOOP.append(LOOP)


class Kind(enum.Enum):
    """A member that stands for a number."""

    ONE = 1.0


class Liar:
    """A number that is none."""

    def __float__(self):
        return math.nan


class Shy:
    """A number that cannot be read."""

    def __float__(self):
        raise RuntimeError("shy")


class Ragged:
    """Three items that cannot be read."""

    def __len__(self):
        return 3

    def __getitem__(self, k):
        raise RuntimeError("gone")


BAD = {
    "a text": "1",
    "bytes": b"1",
    "a truth value": True,
    "one of NumPy": np.True_,
    "not a number": math.nan,
    "infinity": math.inf,
    "zero": 0.0,
    "a number below zero": -1.0,
    "complex": np.complex128(2 + 5j),
    "beyond all numbers": 10**400,
    "more digits than Python writes": 10**5000,
    "an instant": datetime.datetime(2020, 1, 1),
    "a span of time": np.timedelta64(5, "s"),
    "a member": Kind.ONE,
    "nothing": None,
    "a function": lambda *_: 0.0,
    "two numbers": [1.0, 2.0],
    "a dict": {0.1: 2.0},
    "an iterator": iter((0.0, 0.0, 1.0)),
    "texts": np.full(3, "1", dtype=object),
    "texts of a matrix": np.full((3, 3), "1", dtype=object),
    "truth values": (True, False, True),
    "masked": np.ma.array([1.0, 2.0, 3.0], mask=[0, 1, 0]),
    "instants": np.zeros(3, dtype="M8[s]"),
    "what contains itself": LOOP,
    "what says that it is none": Liar(),
    "what fails as a number": Shy(),
    "what fails item by item": Ragged(),
}
WHOLE = "increments", "shapes", "min_cells"  # numbers, however large
SIGNED = "since", "value", "high", "torque", "rest"
MAY_BE_ZERO = *SIGNED, "xi", "damping", "length", "friction", "nu", "c10", "c01"
SOFT = {(kind, "stiffness") for kind in (rf.Spring, rf.SpringDamper, rf.JointSpring)}
NONE_OF_IT = SOFT | {(rf.StrainRate, "tol")}  # may be zero, and not in other records
LISTS = {(rf.Table, "times"), (rf.Table, "values"), (rf.Release, "at")}


def _is_number(value):
    try:
        return np.asarray(value, dtype=float).size > 0
    except (TypeError, ValueError):
        return False


NUMBERS = [
    (record, name)
    for record, given in RECORDS.items()
    if record not in (Curve, EntitySet)  # of arrays
    for name, value in given().items()
    if _is_number(value)
]


def _default(record, name):
    return record.__dataclass_fields__[name].default


def _is_right(record, name, kind):
    """Whether a kind has a meaning for a field."""
    return (
        (kind == "nothing" and _default(record, name) is None)
        or (kind in ("beyond all numbers", "more digits than Python writes") and name in WHOLE)
        or (kind == "a number below zero" and name in SIGNED)
        or (kind == "zero" and (name in MAY_BE_ZERO or (record, name) in NONE_OF_IT))
        or (kind == "infinity" and name in ("until", "load_change"))
        or (kind == "a function" and name in ("value", "torque"))
        or (kind == "two numbers" and (record, name) in LISTS)
    )


@pytest.mark.parametrize(("record", "name"), NUMBERS, ids=lambda x: getattr(x, "__name__", x))
def test_is_refused(record, name):
    for kind, value in BAD.items():
        if _is_right(record, name, kind):
            continue
        with pytest.raises(rf.SceneError) as caught:
            record(**RECORDS[record]() | {name: value})
        message = str(caught.value)
        assert record.__name__ in message, kind
        assert name.split("_")[0] in message, kind  # axis, of axis_a


@pytest.mark.parametrize(
    "record", [r for r, given in RECORDS.items() if "where" in given()], ids=lambda r: r.__name__
)
@pytest.mark.parametrize(
    "where", [None, 3, b"x0", ["x0", "x1"], Kind.ONE, "", "x0 ", "X0"], ids=repr
)
def test_a_set_is_named_by_its_text(record, where):
    if where is None and _default(record, "where") is None:
        return  # that is all cells
    with pytest.raises(rf.SceneError, match=record.__name__):
        rf.Scene(
            rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)),
            rf.StVenantKirchhoff(rho=1.0, E=1.0, nu=0.3),
            [record(**RECORDS[record]() | {"where": where})],
        )
