"""Why a step has no solution: how Newton's method fails, and loads beyond the material."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from rigidfx.scene.scene import Scene
from rigidfx.step.newton.solution import Solution
from rigidfx.step.newton.stopping_test import MARGIN

__all__ = ["course", "overload"]


def course(solution: Solution) -> str:
    """How Newton's method failed, by its residuals.

    Args:
        solution: A solve that has not converged.
    """
    residuals = solution.residuals
    if not residuals or not np.isfinite(residuals).all():
        return "a force is not finite"
    if residuals[-1] <= MARGIN * solution.rounding:
        return (
            f"all that is left is rounding: forces are known to {solution.rounding:.1e} N at best, "
            "as stiff parts are strained so little. A larger Δt, Rigid parts where they are "
            "stiffest, or lengths of the order of a metre help"
        )
    return "residuals grow" if residuals[-1] > residuals[0] else "residuals no longer fall"


def overload(scene: Scene, t: float) -> str:
    """A load on the deformed surface that is more than the material bears, or nothing. Collective.

    Args:
        scene: The problem.
        t: When the load acts [s].
    """
    for effect in scene.acting(t):
        pushed = effect.pushes(t)
        if pushed is None:
            continue
        where, size = pushed
        cells = scene.boundary(where, effect.kind)[:, 0]
        own = [m.stiffness for m, of in scene.materials if np.isin(of, cells).any()]
        softest = scene.comm.allreduce(min(own, default=np.inf), op=MPI.MIN)
        # E/√27 per undeformed area is the most that St.Venant-Kirchhoff's material bears in
        # compression: λE(λ² - 1)/2 at the stretch λ = 1/√3.
        if size > softest / (3 * 3**0.5):
            return (
                f"{effect.owner} has {size:.3g} Pa at t = {t:.6g} s, {size / softest:.2g} of the "
                f"stiffness of the material there, {softest:.3g} Pa: more than it bears. Are both "
                "in pascals (1 MPa is 1e6)? A load that grows slowly shows how far it goes."
            )
    return ""
