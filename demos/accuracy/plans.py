"""Which settings are compared: a base, a reference, knobs turned one at a time, and several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from .setting import Setting


def plan(
    base: Setting,
    short: bool,
    *,
    tols: Sequence[float],
    windows: Sequence[float],
    sharp: float,
    finer: bool = True,
) -> dict[str, Setting]:
    """The settings of a structure by their labels, which name the knob first.

    Args:
        base: The setting that all others differ from.
        short: Few settings, of first order.
        tols: Tolerances besides the base's [1/s].
        windows: Windows besides the base's [s].
        sharp: The tolerance beside half of Δt [1/s]; 0 for none.
        finer: Whether there is time for the base on a finer mesh.
    """
    if short:
        base = replace(base, order=1)
    return {
        "reference": replace(
            base,
            tol=0.0,
            mass="consistent",
            refine=1 if short else 2,
            dt=base.dt / 2 if short else base.dt / 4,
            newton=1e-12,
        ),
        "base": base,
        **(_few(base) if short else _turned(base, tols, windows, finer)),
        **_automatic(base, (0.05,) if short else (0.05, 0.01, 0.002)),
        **({} if short else _combined(base, sharp, max(tols))),
    }


def _automatic(base: Setting, budgets: Sequence[float]) -> Mapping[str, Setting]:
    """Nothing set by hand but the longest step, twice the base's."""
    return {
        f"automatic, {100 * budget:g} %": replace(base, tol=0.0, dt=2 * base.dt, budget=budget)
        for budget in budgets
    }


def _few(base: Setting) -> Mapping[str, Setting]:
    return {
        "all flexible": replace(base, tol=0.0),
        "Δt × 2": replace(base, dt=2 * base.dt),
    }


def _turned(
    base: Setting, tols: Sequence[float], windows: Sequence[float], finer: bool
) -> Mapping[str, Setting]:
    """One knob of the base turned at a time.

    The solvers are compared with elements of first order. With those of second order a run by the
    less suitable one takes a quarter of an hour, and one of the body on a finer mesh an hour.
    """
    order_1 = replace(base, order=1)
    ξ = {"ξ × 2": replace(base, damping=2 * base.damping), "ξ = 0": replace(base, damping=0.0)}
    return {
        **{f"tolerance × {tol / base.tol:g}": replace(base, tol=tol) for tol in tols},
        **{f"window × {w / base.window:g}": replace(base, window=w) for w in windows},
        **_few(base),
        "Δt / 2": replace(base, dt=base.dt / 2),
        **({"mesh / 2": replace(base, refine=2)} if finer else {}),
        "order 1": order_1,
        "order 1, mesh / 2": replace(order_1, refine=2),
        "order 1, direct": replace(order_1, solver="direct"),
        "order 1, Krylov": replace(order_1, solver="Krylov"),
        "consistent mass": replace(base, mass="consistent"),
        **(ξ if base.damping else {"ξ = 0.02": replace(base, damping=0.02 * base.dt)}),
        **{f"Newton {rtol:g}": replace(base, newton=rtol) for rtol in (1e-12, 1e-3)},
    }


def _combined(base: Setting, sharp: float, blunt: float) -> Mapping[str, Setting]:
    """Settings that turn several knobs: coarse ones and a fine one.

    What Δt and Newton save is not to be credited to rigid parts: each is there without them too.
    """
    times = f"tolerance × {sharp / base.tol:g}" if sharp else "all flexible"
    return {
        f"Δt × 2, tolerance × {blunt / base.tol:g}, Newton 0.001": replace(
            base, dt=2 * base.dt, tol=blunt, newton=1e-3
        ),
        f"Δt / 2, {times}": replace(base, dt=base.dt / 2, tol=sharp),
        "flexible, Newton 0.001": replace(base, tol=0.0, newton=1e-3),
        "Δt × 2, flexible, Newton 0.001": replace(base, dt=2 * base.dt, tol=0.0, newton=1e-3),
        "Δt × 2, Newton 0.001": replace(base, dt=2 * base.dt, newton=1e-3),
    }
