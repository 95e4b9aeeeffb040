"""Why cells are released, in the words of events."""

from __future__ import annotations

__all__ = ["ASKED", "CHECKED", "FAILED", "OUTGROWN"]

CHECKED = "checked: forces would strain them"  # the step is solved again
ASKED = "checked: a condition"
FAILED = "the error motion failed"
OUTGROWN = "forces strain them otherwise than their shapes can"
