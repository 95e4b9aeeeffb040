"""What several tests share: the reference problem, markers, and numbers of a history."""

import csv
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from tumbling_l import tumbling_l

import rigidfx as rf
from rigidfx.command.pair import energy_drift as imbalance  # noqa: F401 (for the tests)
from rigidfx.effects import Effect

Array = npt.NDArray[np.float64]

EPS = float(np.finfo(np.float64).eps)
NEWTON = 1e-12  # ‖R‖ at which Newton stops, relative to the first iterate's

TRIANGLE = rf.Table((0.0, 2.5, 5.0), (0.0, 2.5, 0.0))
LOAD_1 = np.array([256.0, 512.0, 768.0]) / 90


def pair_of_tractions(a: str, b: str, value: Array, time: rf.Table) -> list[rf.Traction]:
    """Opposite tractions on two faces of equal area until the table ends: no net force."""
    end = time.times[-1]
    return [
        rf.Traction(face, tuple(sign * value), time=time, until=end)
        for face, sign in ((a, 1.0), (b, -1.0))
    ]


def tumbling(
    material: rf.Material, *effects: Effect, load: float = 1.0, **discretisation: Any
) -> rf.Scene:
    """The tumbling L under so many times load 1; free from t = 5 s on."""
    tractions = pair_of_tractions("top", "side", load * LOAD_1, TRIANGLE)
    return rf.Scene(tumbling_l(), material, [*tractions, *effects], **discretisation)


def between(low: float, high: float) -> Callable[[Array], npt.NDArray[np.bool_]]:
    """A marker of what lies between two values of x [m]."""
    return lambda x: (x[0] >= low - 1e-9) & (x[0] <= high + 1e-9)


def sizes(domain: rf.Domain) -> dict[tuple[str, int], int]:
    """How many entities each set of a mesh has."""
    return {key: domain.count(entities) for key, entities in domain.sets.items()}


def table(path: Path) -> list[dict[str, str]]:
    """The rows of a table that a recorder has left."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@contextmanager
def heard(words: str = "") -> Iterator[list[str]]:
    """Texts of the warnings that come and hold these words, there at the end."""
    texts: list[str] = []
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        yield texts
    texts += [str(w.message) for w in shown if words in str(w.message)]


def tips(reports: Iterable[rf.Report]) -> Array:
    """Displacements of the probe "tip", shape (reports, 3) [m]."""
    return np.array([r.probes["tip"] for r in reports])


def column(reports: list[rf.Report], name: str) -> Array:
    """One number, or one vector, of all reports."""
    return np.array([getattr(r, name) for r in reports])


def drift(values: Array) -> float:
    """Largest distance from the first value, relative to that value's size."""
    sizes = np.abs(values) if values.ndim == 1 else np.linalg.norm(values, axis=1)
    moved = values - values[0]
    moved = np.abs(moved) if values.ndim == 1 else np.linalg.norm(moved, axis=1)
    return float(moved.max() / sizes[0])


def linear_momentum(reports: list[rf.Report]) -> float:
    """Largest ‖L‖ relative to Σ m|v|."""
    sizes = np.linalg.norm(column(reports, "linear_momentum"), axis=1)
    return float((sizes / column(reports, "momentum_scale")).max())


def since(reports: list[rf.Report], t: float) -> list[rf.Report]:
    """The reports from t [s] on."""
    return [r for r in reports if r.t >= t - 1e-9]


def show(**measured: float) -> None:
    """Print what was measured; `pytest -rP` shows it."""
    print(", ".join(f"{name} = {value:.3g}" for name, value in measured.items()))


def drifts(reports: list[rf.Report]) -> dict[str, float]:
    """Drifts of a free, unsupported body without net momentum."""
    out = {
        "energy": drift(column(reports, "energy")),
        "angular_momentum": drift(column(reports, "angular_momentum")),
        "linear_momentum": linear_momentum(reports),
    }
    show(**out)
    return out


def largest(rows: list[dict[str, Any]], key: str) -> float:
    """The largest number in lists of that name."""
    return max((abs(x) for row in rows for x in row[key]), default=0.0)


def apart(one: list[dict[str, Any]], several: list[dict[str, Any]], key: str) -> float:
    """The largest difference between lists of that name, which are as long in both histories."""
    worst = 0.0
    for a, b in zip(one, several, strict=True):
        assert len(a[key]) == len(b[key])
        worst = max([worst, *(abs(x - y) for x, y in zip(a[key], b[key], strict=True))])
    return worst
