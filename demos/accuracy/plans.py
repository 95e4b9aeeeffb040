"""Which settings are compared: a base, a reference, knobs turned one at a time, and several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from .setting import Setting

__all__ = ["COARSER", "MESH", "REFERENCE", "plan"]

# Runs that tell of errors, and are none of those compared:
REFERENCE = "reference"
COARSER = "Δt / 16 of the reference's kind"  # which twice the reference's steps make
MESH = "mesh / 2"  # all flexible; against "all flexible" it tells what the mesh changes


def plan(
    base: Setting,
    short: bool,
    *,
    tols: Sequence[float],
    windows: Sequence[float],
    sharp: float,
    finer: bool = False,
) -> dict[str, Setting]:
    """The settings of a structure by their labels, which name the knob first.

    Args:
        base: The setting that all others differ from.
        short: Few settings.
        tols: Tolerances besides the base's [1/s].
        windows: Windows besides the base's [s].
        sharp: The tolerance beside half of Δt [1/s]; 0 for none.
        finer: Whether there is time for finer elements: of second order, and of half the size.
    """
    exact = replace(base, tol=0.0, newton=1e-12)
    return {
        REFERENCE: replace(exact, dt=base.dt / (2 if short else 32)),
        **({} if short else {COARSER: replace(exact, dt=base.dt / 16)}),
        **({MESH: replace(base, tol=0.0, refine=2)} if finer and not short else {}),
        "base": base,
        **_few(base),
        **({} if short else _turned(base, tols, windows)),
        **({"order 2": replace(base, order=2)} if finer and not short else {}),
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
    base: Setting, tols: Sequence[float], windows: Sequence[float]
) -> Mapping[str, Setting]:
    """One knob of the base turned at a time."""
    damping = {"damping × 2": 2 * base.damping, "no damping": 0.0}
    if not base.damping:
        damping = {"damping, ξ = 0.02": 0.02 * base.dt}
    return {
        **{f"tolerance × {tol / base.tol:g}": replace(base, tol=tol) for tol in tols},
        **{f"window × {w / base.window:g}": replace(base, window=w) for w in windows},
        "Δt / 2": replace(base, dt=base.dt / 2),
        **{label: replace(base, damping=β) for label, β in damping.items()},
        "consistent mass": replace(base, mass="consistent"),
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
        "flexible, Δt × 2": replace(base, tol=0.0, dt=2 * base.dt),
        "flexible, Δt / 2": replace(base, tol=0.0, dt=base.dt / 2),
        "flexible, Newton 0.001": replace(base, tol=0.0, newton=1e-3),
        "Δt × 2, flexible, Newton 0.001": replace(base, dt=2 * base.dt, tol=0.0, newton=1e-3),
        "Δt × 2, Newton 0.001": replace(base, dt=2 * base.dt, newton=1e-3),
    }
