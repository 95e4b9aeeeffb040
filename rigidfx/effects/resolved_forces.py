"""A choice: forces of supports and joints without vibration that steps do not resolve."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.effects.base import Effect

__all__ = ["ResolvedForces"]


@dataclass(frozen=True)
class ResolvedForces(Effect):
    """Reactions, forces of joints and torques of motors without vibration faster than Δt.

    Flexible parts that start or are struck vibrate in all frequencies that their cells have. Those
    far above 1/Δt alternate from step to step for ever, and reactions with them. With this effect
    reports, files and peaks have the forces of the motion that Δt resolves: of a vibration with n
    steps a period 0.99 at n = 10, 0.997 at 13. The motion, its energy and its work stay as they
    are; `report.impulse` has the rest. Each step takes one tangent, with its factors, more.
    """
