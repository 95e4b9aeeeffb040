"""Pictures of numbers against time: the history of a run, curves of several runs.

Every function here is called on all ranks; rank 0 draws, and its errors are raised on all ranks.
matplotlib is imported where it is used, not with the package.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import floor, isfinite, log10
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import OutputError, RigidfxError, SceneError, agree
from rigidfx.base.inputs import number, numbers, path_of, shown
from rigidfx.base.instants import reached
from rigidfx.base.taken import take_fields
from rigidfx.base.types import Array
from rigidfx.output.history import columns_of

STYLE = {
    "font.size": 12,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "grid.color": "0.9",
    "legend.frameon": False,
    "lines.linewidth": 1.3,
}
BLUE, ORANGE, GREEN, DARK = "#0072b2", "#d55e00", "#009e73", "#222222"
COLOURS = (BLUE, ORANGE, GREEN, "#cc79a7", "#56b4e9", "#e69f00")
DPI = 150
HISTORY = (
    *("t", "energy", "kinetic", "strain", "stored", "momentum_scale"),
    *(f"{vector}_{axis}" for vector in "LJ" for axis in "xyz"),
)


def histories(
    history: str | Path | Mapping[str, Array],
    path: str | Path,
    *,
    free_since: float | None = None,
    title: str = "",
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> None:
    """Draw energies and momenta against time. Collective.

    Args:
        history: A history.csv, or its columns by name.
        path: Picture to write.
        free_since: Time [s] from which on energy and momenta should be constant; if given, a
            further panel shows how far they are.
        title: Heading.
        comm: Ranks that call this.

    Raises:
        OutputError: If the picture cannot be drawn or written, or the history cannot be read.
        SceneError: If an argument cannot be used.
    """
    path = path_of("histories", "path", path)
    check_time("histories", free_since)
    if not is_table(history):
        path_of("histories", "history", history)

    def draw() -> None:
        h = _columns_of(history, free_since)
        t = h["t"]
        rows = 3 if free_since is None else 4
        figure, axes = figure_of(rows, 1, (9.0, 2.4 * rows + 0.6), title, sharex=True)
        energy, linear, angular = axes[:3, 0]
        energy.plot(t, h["energy"], color=DARK, label="total $H$")
        energy.plot(t, h["kinetic"], color=BLUE, label="kinetic")
        energy.plot(t, h["strain"], color=ORANGE, label="strain")
        others = {"stored": "stored in bodies", "springs": "springs", "contact": "contacts"}
        for (name, label), colour in zip(others.items(), COLOURS[2:], strict=False):
            if name in h and np.any(h[name]):  # or the parts would not make the whole
                energy.plot(t, h[name], color=colour, label=label)
        energy.set_ylabel("energy (J)")
        _components(linear, t, h, "L")
        linear.set_ylabel("linear momentum\n(kg m/s)")
        _components(angular, t, h, "J")
        angular.set_ylabel("angular momentum\n(kg m²/s)")
        if free_since is not None:
            _drifts(axes[3, 0], h, free_since)
        axes[-1, 0].set_xlabel("time (s)")
        axes[-1, 0].set_xlim(t[0], t[-1])
        for ax in axes[:, 0]:
            ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        save(figure, path)

    on_first_rank(comm, draw, f"histories: '{path}'")


def check_time(owner: str, free_since: float | None) -> None:
    """Refuse a time from which on a body is free that is neither a number nor None."""
    if free_since is not None:
        number(owner, "free_since", free_since)


def _columns_of(
    history: str | Path | Mapping[str, Array], free_since: float | None
) -> Mapping[str, Array]:
    """The columns that are drawn; a missing or empty one raises `OutputError`."""
    given: Any = history
    h = {n: np.asarray(given[n]) for n in given} if is_table(given) else columns_of(given)
    for name in HISTORY:
        if name not in h:
            raise OutputError(f"the history has no column '{name}'")
    if np.size(h["t"]) == 0:
        raise OutputError("the history has no steps yet")
    if free_since is not None and not free_since <= h["t"][-1]:
        raise OutputError(
            f"free_since = {free_since:g} s is after the last step, at {h['t'][-1]:g} s"
        )
    return h


def is_table(history: object) -> bool:
    """Whether it has columns by name: a mapping, or a table of pandas."""
    return isinstance(history, Mapping) or hasattr(history, "columns")


def _components(ax: Any, t: Array, h: Mapping[str, Array], name: str) -> None:
    for axis, colour in zip("xyz", COLOURS, strict=False):
        ax.plot(t, h[f"{name}_{axis}"], color=colour, label=f"${name}_{axis}$")


def _drifts(ax: Any, h: Mapping[str, Array], free_since: float) -> None:
    """Relative deviations from the values at a time; none is shown below the rounding unit."""
    free = reached(h["t"], free_since, np.diff(h["t"], prepend=h["t"][0]))
    t, H = h["t"][free], h["energy"][free]
    J = np.stack([h[f"J_{axis}"][free] for axis in "xyz"], axis=1)
    L = np.stack([h[f"L_{axis}"][free] for axis in "xyz"], axis=1)
    drifts = {
        "$|H - H_0|\\,/\\,H_0$": (np.abs(H - H[0]) / abs(H[0]), DARK),
        "$|J - J_0|\\,/\\,|J_0|$": (np.linalg.norm(J - J[0], axis=1) / np.linalg.norm(J[0]), GREEN),
        "$|L - L_0|\\,/\\,\\Sigma\\, m|v|$": (
            np.linalg.norm(L - L[0], axis=1) / h["momentum_scale"][free],
            BLUE,
        ),
    }
    rounding = float(np.finfo(np.float64).eps) / 2
    for label, (values, colour) in drifts.items():
        ax.semilogy(t, np.maximum(values, rounding), color=colour, label=label, linewidth=1.0)
    ax.set_ylabel(f"relative change\nsince {free_since:g} s")


@dataclass(frozen=True)
class Curve:
    """A curve of a panel."""

    label: str  # name in the legend of the first panel that has it; it has one colour in all panels
    x: Sequence[float] | Array  # abscissae
    y: Sequence[float] | Array  # ordinates
    broken: bool = False  # whether the run behind it broke down at its end; marked by a cross

    def __post_init__(self) -> None:
        """Copy the points, and check them.

        Raises:
            SceneError: If there are none, or as many abscissae as ordinates are not.
        """
        take_fields(self)
        x, y = numbers(self.x), numbers(self.y)
        if x.ndim != 1 or x.shape != y.shape or x.size == 0:
            raise SceneError(
                f"Curve '{self.label}': x and y must be lists of numbers, of the same length ≥ 1."
            )


def curves(
    panels: Mapping[str, Sequence[Curve]],
    path: str | Path,
    *,
    xlabel: str,
    ylabel: str | Sequence[str],
    title: str = "",
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> None:
    """Draw curves in one panel below the other. Collective.

    Args:
        panels: Heading of each panel → its curves.
        path: Picture to write.
        xlabel: Quantity and unit of the abscissa.
        ylabel: Quantity and unit of the ordinate, one for all panels or one for each.
        title: Heading of the figure.
        comm: Ranks that call this.

    Raises:
        OutputError: If the picture cannot be drawn or written.
        SceneError: If an argument cannot be used.
    """
    path = path_of("curves", "path", path)
    _check_panels(panels, ylabel)

    def draw() -> None:
        figure, axes = figure_of(len(panels), 1, (9.0, 3.1 * len(panels) + 0.5), title, sharex=True)
        colours: dict[str, str] = {}
        legends: set[str] = set()
        ylabels = [ylabel] * len(panels) if isinstance(ylabel, str) else ylabel
        rows = zip(axes[:, 0], panels.items(), ylabels, strict=True)
        for ax, (heading, group), label in rows:
            for curve in group:
                colour = colours.setdefault(curve.label, COLOURS[len(colours) % len(COLOURS)])
                ax.plot(curve.x, curve.y, color=colour, label=curve.label)
                if curve.broken:
                    end = (curve.x[-1], curve.y[-1])
                    ax.plot(*end, "X", color=colour, markersize=10, zorder=5)
                    ax.annotate(
                        f"{end[0]:.4g}",
                        end,
                        xytext=(9, 2),
                        textcoords="offset points",
                        color=colour,
                    )
            ax.set_title(heading)
            ax.set_ylabel(label)
            if not {curve.label for curve in group} <= legends:
                ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
            legends |= {curve.label for curve in group}
        axes[-1, 0].set_xlabel(xlabel)
        save(figure, path)

    on_first_rank(comm, draw, f"curves: '{path}'")


def _check_panels(panels: Any, ylabel: str | Sequence[str]) -> None:
    if not isinstance(panels, Mapping):
        raise SceneError(
            f"curves: panels must be a dict of headings to curves, got {shown(panels)}."
        )
    if not panels:
        raise SceneError("curves: panels must name at least one panel.")
    for heading, group in panels.items():
        if not isinstance(group, Sequence) or not all(isinstance(c, Curve) for c in group):
            raise SceneError(f"curves: panel '{heading}' must hold Curve records.")
        if not group:
            raise SceneError(f"curves: panel '{heading}' has no curves.")
    if not isinstance(ylabel, str) and len(ylabel) != len(panels):
        raise SceneError(
            f"curves: ylabel must be one text, or one for each of the {len(panels)} panels, got "
            f"{ylabel!r}."
        )


def figure_of(
    rows: int, columns: int, size: tuple[float, float], title: str, sharex: bool = False
) -> tuple[Any, Any]:
    """A figure that needs no screen, and its axes, shape (rows, columns)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, sharex=sharex, squeeze=False)
    if title:
        figure.suptitle(title, fontsize=14)
    return figure, axes


def save(figure: Any, path: str | Path) -> None:
    """Write a figure, and make the folder for it."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=DPI)


def on_first_rank(comm: MPI.Intracomm, draw: Callable[[], None], what: str) -> None:
    """Call `draw` on rank 0 and raise its error on all ranks."""
    problem = None
    if comm.rank == 0:
        try:
            from matplotlib import rc_context

            with rc_context(STYLE):
                draw()
        except ImportError as error:
            problem = f"{what}: {error}. Pictures need matplotlib, those of shapes pyvista as well."
        except RigidfxError as error:
            problem = f"{what} could not be drawn: {error}"
        except Exception as error:
            problem = f"{what} could not be drawn: {type(error).__name__}: {error}"
    agree(comm, problem, OutputError)


PREFIXES = "p", "n", "µ", "m", "", "k", "M", "G", "T"  # of 10⁻¹² and so on


def prefixed(unit: str, largest: float) -> tuple[float, str]:
    """The factor from a unit to one with a prefix, by the largest number shown, and its name.

    A unit that begins with a digit, such as "1/s", takes no prefix.
    """
    if not unit or unit[0].isdigit() or not isfinite(largest) or largest <= 0:
        return 1.0, unit
    middle = len(PREFIXES) // 2
    thousands = min(max(floor(log10(largest) / 3), -middle), middle)
    return 10.0 ** (-3 * thousands), PREFIXES[thousands + middle] + unit
