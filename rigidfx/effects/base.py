"""The base of all effects: checks, time windows, functions of time and place, and binding.

Functions of place and time, f(x, t), stand beside those of time alone, f(t).
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields
from math import inf, isfinite
from typing import Any, ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError, by_name, together
from rigidfx.base.inputs import is_function, number, numbers, of_time, scalar, shown, whole
from rigidfx.base.taken import Checks, check_fields, take_fields
from rigidfx.base.types import Array, Indices, Ints
from rigidfx.effects.action import Action, FormTerm, Structure

Vector = tuple[float, float, float]
NO_VECTOR: Vector = (0.0, 0.0, 0.0)
Kind = TypeVar("Kind", bound="Effect")
ANY_SET = (2, 3, 1, 0)  # dimensions of named sets, facets first
WHOLE = "all cells"  # what goes by this name is not a set of cells but the whole domain

TimeFunction = Callable[[float], float]


@dataclass(frozen=True)
class Table:
    """A piecewise linear function of time; constant before the first and after the last time.

    Every interior kink is a breakpoint at which a step ends.

    Attributes:
        times: Strictly increasing instants [s].
        values: Value at each instant, in the unit of its product.
    """

    times: Sequence[float]
    values: Sequence[float]

    def __post_init__(self) -> None:
        """Raise `SceneError` if lengths differ, times do not increase or a number is not finite."""
        take_fields(self)
        times, values = numbers(self.times), numbers(self.values)
        if times.ndim != 1 or times.shape != values.shape or times.size == 0:
            raise SceneError(
                "Table: times and values must be lists of numbers, of the same length ≥ 1."
            )
        if not (np.isfinite(times).all() and np.isfinite(values).all()):
            raise SceneError("Table: times and values must be finite.")
        if np.any(np.diff(times) <= 0):
            raise SceneError("Table: times must increase strictly; a jump takes a time window.")

    def __call__(self, t: float) -> float:
        """Value at time t [s]."""
        return float(np.interp(t, self.times, self.values))

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Instants of the kinks [s]."""
        return tuple(float(t) for t in self.times)

    @property
    def bends(self) -> Mapping[float, float]:
        """Change of slope at each kink over the largest value, by its instant [1/s]."""
        times, values = numbers(self.times), numbers(self.values)
        slopes = np.concatenate([[0.0], np.diff(values) / np.diff(times), [0.0]])
        largest = max(float(np.abs(values).max()), float(np.finfo(np.float64).tiny))
        changes = np.abs(np.diff(slopes)) / largest
        return dict(zip(map(float, times), map(float, changes), strict=True))


@dataclass(frozen=True)
class Effect:
    """Anything a scene may name; it keeps its values as they were given."""

    is_load: ClassVar[bool] = False  # whether its windows and changes are changes of a load
    is_dead: ClassVar[bool] = False  # whether it is but forces that the motion does not change
    is_lasting: ClassVar[bool] = False  # whether its forces act at all times, in statics too
    holds: ClassVar[bool] = False  # whether what it acts on cannot drift away
    is_rigid: ClassVar[bool] = False  # whether the cells it names never strain
    is_body: ClassVar[bool] = False  # whether they are a body, which may deform by shapes
    is_windowed: ClassVar[bool] = False  # whether it acts in a time window
    is_support: ClassVar[bool] = False  # whether it holds dofs
    is_contact: ClassVar[bool] = False  # whether it presses where things meet
    prescribes: ClassVar[bool] = False  # whether a motor, whose motion is given
    uniform: ClassVar[bool] = True  # whether a load is the same at all places
    grows: ClassVar[str | None] = None  # the field by which statics let a constant load grow
    face: ClassVar[Any] = None  # the face at whose point it acts
    places: ClassVar[tuple[type, ...]] = (str,)  # kinds of places that it may act on
    in_runs: ClassVar[str | None] = None  # of an effect of runs only: what statics take instead
    checks: ClassVar[Checks] = {}  # of its fields
    on_cells: ClassVar[bool] = False  # whether it acts on a set of cells
    breakpoints: ClassVar[tuple[float, ...]] = ()  # instants at which a step must end [s]
    joins: ClassVar[tuple[str | None, ...]] = ()  # sets it keeps together; None means all
    keeps_apart: ClassVar[tuple[str, ...]] = ()  # two sets of facets that press where they meet
    mass_damping: ClassVar[float] = 0.0  # α of a drag α M v that it is [1/s]
    numerical_damping: ClassVar[float | None] = None  # ξ of the scheme, if it has a say in that
    ground_stiffness: ClassVar[Array | None] = None  # total, against the ground, (3, 3) [N/m]

    def __post_init__(self) -> None:
        """Copy its values; raise `SceneError` unless `where` and other fields pass their checks."""
        take_fields(self)
        for default in (own.default for own in fields(self) if own.name == "where"):
            where = getattr(self, "where", None)
            if not (isinstance(where, self.places) or where is default is None):
                wanted = "where must be the name of a set"
                raise SceneError(f"{self.kind}: {wanted}, got {shown(where)}.")
        check_fields(self, self.checks)

    @property
    def kind(self) -> str:
        """Its name."""
        return type(self).__name__

    @property
    def owner(self) -> str:
        """Its name in messages, and the set that it acts on, or those that it joins."""
        where = getattr(self, "where", None)
        sets = (where,) if hasattr(self, "where") else self.joins or (None,)
        named = "' and '".join(str(name or WHOLE) for name in sets)
        return f"{self.kind} on '{named}'"

    def placed(self, scene: Any) -> Effect:
        """The effect with data from the mesh; itself without, or a `SceneError`. Collective.

        The scene's space and start places are known already.
        """
        return self

    def _with(self: Kind, **data: Any) -> Kind:
        """The effect with data from the mesh."""
        out = copy(self)
        vars(out).update(data)
        return out

    def check(self, scene: Any) -> None:
        """Raise `SceneError` if a name is unknown, or a function cannot be used. Collective.

        The scene's mesh, space and masses are known already.
        """
        if self.on_cells:
            scene.owned_cells(getattr(self, "where", None), self.kind)

    def signal(self, t: float, dt: float) -> Array:
        """Numbers whose change is a change of load at t; dt scales a difference quotient [s]."""
        return np.empty(0)

    def pushes(self, t: float) -> tuple[str, float] | None:
        """Facets on whose deformed surface it acts, and its stress at t in size [Pa]; or None."""
        return None

    def nodal_mass(self, scene: Any) -> Array | None:
        """Mass that it adds to each local node, ghosts included [kg]; None if none. Collective.

        The scene's mesh and space are known already.
        """
        return None

    def bind(self, structure: Structure) -> Action | None:
        """Its action on nodes and bodies of a division; None if it has none. Collective."""
        return None

    def bind_points(self, structure: Structure) -> Action | None:
        """Its action on points of faces and mean places, `RemoteNodes`; or None. Collective."""
        return None

    def term(self, mesh: Any) -> FormTerm | None:
        """Its term of the compiled forms; None if it has none."""
        return None


def must_be(words: str, good: Callable[[Any], bool]) -> Callable[[str, str, Any], None]:
    """A check of a field: its values in words, and whether a given one is good."""

    def check(owner: str, name: str, value: Any) -> None:
        if not good(value):
            raise SceneError(f"{owner}: {name} must be {words}, got {shown(value)}.")

    return check


def at_least_one(owner: str, name: str, value: Any) -> None:
    """Check that a field is a whole number ≥ 1."""
    whole(owner, name, value, least=1)


def is_truth(value: Any) -> bool:
    """Whether a value is True or False."""
    return isinstance(value, (bool, np.bool_))


def one_of(*names: str) -> Callable[[str, str, Any], None]:
    """A check that a field is one of some words."""
    words = " or ".join(map(repr, names))
    return must_be(words, lambda value: isinstance(value, str) and value in names)


def text(words: str) -> Callable[[str, str, Any], None]:
    """A check that a field is a text that is not empty, such as the name of a joint."""
    return must_be(words, lambda value: isinstance(value, str) and value != "")


def check_values(
    owner: str, t: float, values: Array, X: Array | None = None, advice: str = ""
) -> Array:
    """Vectors that a user's function gives at t [s], as they are: one, or one for each of points X.

    `SceneError` on this rank, unless they are finite.
    """
    shapes = ((3,),) if X is None else ((3,), X.shape)
    if np.shape(values) in shapes and np.isfinite(values).all():
        return values
    if X is None:
        wanted, given = "", values if np.size(values) else "what is no array of real numbers"
    else:
        wanted = f" for each of {len(X)} points"
        given = f"{values.T}, shape {values.T.shape} in place of (3, {len(X)})"
    raise SceneError(
        f"{owner}: at t = {t:g} s three finite components{wanted} are expected, got "
        f"{given}.{advice}"
    )


def vector_at(owner: str, what: str, t: float, function: Callable[[], Array]) -> Array:
    """Three finite numbers that a user's function gives at t [s]; raise on this rank if not."""
    value = by_name(owner, t, function, what)
    return check_values(owner, t, value, advice=f" Check its {what}.")


def mean_over(value: Callable[[float], Any], t: float, dt: float) -> Any:
    """Mean of a load over a step of Δt about its middle t [s], by Gauss's two points.

    So the impulse of a load is exact to fourth order, whatever the lengths of steps. It is the
    value at t where Δt is zero.
    """
    if not dt:
        return value(t)
    apart = dt / np.sqrt(12)
    return 0.5 * value(t - apart) + 0.5 * value(t + apart)


@dataclass(frozen=True)
class Windowed(Effect):
    """An effect that acts in a time window.

    Attributes:
        since: Start of the window [s].
        until: End of the window [s].
    """

    is_windowed: ClassVar[bool] = True

    since: float = field(default=-inf, kw_only=True)
    until: float = field(default=inf, kw_only=True)

    def __post_init__(self) -> None:
        """Raise `SceneError` if the window is empty or its ends are not numbers."""
        super().__post_init__()
        since, until = (
            number(self.kind, name, getattr(self, name), infinite=True)
            for name in ("since", "until")
        )
        if not since < until:
            raise SceneError(
                f"{self.kind}: the time window needs since < until, "
                f"got {shown(self.since)} … {self.until!r}."
            )
        kinks = [t for own in fields(self) for t in self._instants_of(own.name)]
        object.__setattr__(self, "_kinks", tuple(t for t in kinks if since < t < until))

    def _instants_of(self, name: str) -> tuple[float, ...]:
        """Instants that a function among its fields names now."""
        owner, given = f"{self.kind}: an instant among the breakpoints of {name}", None
        try:
            given = getattr(getattr(self, name), "breakpoints", ())
            return tuple(number(owner, "t", t, infinite=True) for t in given)
        except SceneError:
            raise
        except Exception:  # whatever a user's attribute may raise
            raise SceneError(
                f"{self.kind}: the attribute breakpoints of {name} must be a list of instants, got "
                f"{shown(given)}."
            ) from None

    @property
    def start(self) -> float:
        """When it first acts in a run [s]."""
        return max(0.0, self.since)

    def acts(self, t: float) -> bool:
        """Whether the effect acts at t [s], or just after it where its window begins or ends."""
        return self.since <= t < self.until

    @property
    def ends(self) -> tuple[float, ...]:
        """Where the window begins and ends, as far as it does [s]."""
        return tuple(t for t in (self.since, self.until) if isfinite(t))

    @property
    def breakpoints(self) -> tuple[float, ...]:  # type: ignore[override]
        """Instants at which a step must end [s]: ends of the window, kinks of functions in it."""
        return (*self.ends, *self._kinks)  # type: ignore[attr-defined]

    @property
    def bends(self) -> Mapping[float, float]:
        """Breakpoints at which a load does not jump, with changes of slope: see `Table.bends`."""
        if not self.is_load:
            return {}
        bends = bends_of([getattr(self, own.name) for own in fields(self)])
        return {t: change for t, change in bends.items() if self.since < t < self.until}

    @property
    def points(self) -> Array:
        """Some points of its set, since it was checked; any one while it is `uniform` [m]."""
        return getattr(self, "_points", np.zeros((1, 3)))

    def check_functions(
        self, scene: Any, nodes: Callable[[], Indices], *functions: Callable[[Array], Array]
    ) -> None:
        """Check vectors at its start, of functions of points of its nodes. Collective.

        `SceneError` on every rank, unless they are finite; nodes are found if it is not `uniform`.
        """
        X, arguments = None, "time"
        if not self.uniform:
            X, arguments = scene.space.tabulate_dof_coordinates()[nodes()], "place and time"
            object.__setattr__(self, "_points", _some_of(scene, X))

        def check() -> None:
            for function in functions:
                values = function(self.points if X is None else X)
                check_values(self.owner, self.start, values, X)

        together(scene.comm, f"{self.owner}: its function of {arguments}", check)


def bends_of(functions: Iterable[Any]) -> dict[float, float]:
    """Breakpoints that are bends of all which name them, in order: most change of slope [1/s]."""
    hard, bends = set[float](), dict[float, float]()
    for function in functions:
        own = function.bends if isinstance(function, (Table, Windowed)) else {}
        hard.update(float(t) for t in getattr(function, "breakpoints", ()) if t not in own)
        bends |= {t: max(change, bends.get(t, 0.0)) for t, change in own.items()}
    return {t: bends[t] for t in sorted(bends.keys() - hard)}


@dataclass(frozen=True)
class Scaled(Windowed):
    """A load with a factor in time.

    Attributes:
        time: Factor as a function of time, such as a `Table`; 1 if None. An attribute
            `breakpoints` of it names instants at which steps must end.
    """

    is_load: ClassVar[bool] = True
    grows: ClassVar[str | None] = "time"
    checks: ClassVar[Checks] = {"time": of_time}

    time: TimeFunction | None = field(default=None, kw_only=True)

    def factor(self, t: float) -> float:
        """The factor at t [s]; zero outside the window."""
        return 0.0 if not self.acts(t) else 1.0 if self.time is None else scalar(self.time(t))

    def moments(self, structure: Structure, weights: Array) -> Array:
        """Σ w a of owned nodes over each body, on this rank, shape (bodies, n). Collective."""
        body, a, _ = structure.bodies.of.holding(structure.u.size // 3)
        held = np.flatnonzero(body[: len(weights)] >= 0)
        out = np.zeros(structure.bodies.pose.shape[:2])
        np.add.at(out, body[held], a[held] * weights[held, None])
        return out


# Positions, shape (3, n) [m], and a time [s] → vectors, shape (3, n).
VectorField = Callable[[Array, float], npt.ArrayLike]
PlaceAndTime = VectorField | Callable[[float], tuple[float, float, float]]


def of_place(function: Any) -> bool:
    """Whether it is a function of place and time: it has to be given two arguments by position."""
    if not is_function(function):
        return False
    try:
        named = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # some built-in functions do not tell
        return False
    places = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(p.kind in places and p.default is p.empty for p in named) == 2


def values_at(function: Callable[..., Any], X: Array, t: float) -> Array:
    """Vectors of a function of place and time at points X and time t, shape (points, 3).

    Unusable values come back as they are, or empty if not of real numbers: see `check_values`.
    """
    if not len(X):  # a rank may have none, and a function may not be made for that
        return np.zeros((0, 3))
    given = numbers(function(X.T.copy(), t)).T
    return np.broadcast_to(given, X.shape) if given.shape in ((3,), (1, 3)) else given


def values_of(owner: str, function: Callable[[Array], npt.ArrayLike], scene: Any) -> Array:
    """Vectors of a function of place at local nodes, ghosts too, shape (nodes, 3). Collective.

    `SceneError` on every rank, unless it maps (3, n) [m] to finite (3, n), or (3,) for all.
    """
    X = scene.space.tabulate_dof_coordinates()

    def found() -> Array:
        given = numbers(function(X.copy().T)).T  # it may change the positions in place
        if len(X) and not given.size:
            raise TypeError("it gives no real numbers")
        values = np.broadcast_to(given, X.shape)
        if not np.isfinite(values).all():
            raise SceneError(f"{owner}: function gives values that are not finite.")
        return values

    return together(scene.comm, f"{owner}: function must map (3, n) to (3, n); it", found)


def _some_of(scene: Any, X: Array) -> Array:
    """A few of the points that ranks have, the same on all ranks, shape (n, 3) [m]. Collective.

    A change of a function of place is a change of a load where it is one at these.
    """
    found = np.concatenate(scene.comm.allgather(X[np.unique(_extremes(X))]))
    return np.asarray(found[np.unique(_extremes(found))])


def _extremes(X: Array) -> Ints:
    """Which points lie furthest along each of several directions and against them."""
    if not len(X):
        return np.empty(0, np.int64)
    along = X @ np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [3, 2, 1], [-2, 3, 1], [1, -1, 5]]).T
    return np.concatenate([along.argmin(axis=0), along.argmax(axis=0)])
