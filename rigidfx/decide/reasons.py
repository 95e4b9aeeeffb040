"""Why cells are released, in the words of events."""

from __future__ import annotations

__all__ = ["ASKED", "CHECKED", "DRIFTED", "FORESEEN", "UNDONE"]

FORESEEN = "predicted: forces will strain them"  # before a step ...
CHECKED = "checked: forces would strain them"  # ... and after it, which is then solved again
ASKED = "checked: a condition"
UNDONE = "checked: what has just frozen would not last"
DRIFTED = "drift: a free motion would be off by half of what wakes cells"
