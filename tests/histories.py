"""What several tests share: the reference problem, markers, and numbers of a history."""

import csv
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from bench import RAMP, pushed_l
from tumbling_l import tumbling_l

import rigidfx as rf
from rigidfx.command.pair import energy_drift as imbalance  # noqa: F401 (for the tests)
from rigidfx.effects import Effect

Array = npt.NDArray[np.float64]

EPS = float(np.finfo(np.float64).eps)
NEWTON = 1e-12  # ‖R‖ at which Newton stops, relative to the first iterate's


def tumbling(material: rf.Material, *effects: Effect, **how: Any) -> rf.Scene:
    """The tumbling L under so many times its load; free from t = 5 s on."""
    return pushed_l(tumbling_l(), *effects, material=material, time=RAMP, until=5.0, **how)


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


def changes(reports: list[rf.Report]) -> list[float]:
    """Largest changes of H, over the first, and of L and J, over the first Σ m|v|."""
    scale = reports[0].momentum_scale
    of = {"energy": reports[0].energy, "linear_momentum": scale, "angular_momentum": scale}
    values = {name: column(reports, name) for name in of}
    return [float(np.abs(values[name] - values[name][0]).max() / of[name]) for name in of]


def linear_momentum(reports: list[rf.Report]) -> float:
    """Largest ‖L‖ relative to Σ m|v|."""
    sizes = np.linalg.norm(column(reports, "linear_momentum"), axis=1)
    return float((sizes / column(reports, "momentum_scale")).max())


def gone_on(
    make: Callable[[], rf.Scene], dt: float, t_end: float, left: rf.Checkpoint, count: int,
    **how: Any,
) -> list[rf.Report]:  # fmt: skip
    """What is left of a run that ends after so many reports and goes on from its checkpoint."""
    cut = rf.simulate(make(), dt, t_end, checkpoint=left, progress=False, **how)
    for _ in range(count):
        next(cut)
    cut.close()
    return list(rf.resume(left.folder, make(), progress=False))


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
