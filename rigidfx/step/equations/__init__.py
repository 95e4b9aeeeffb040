"""The equations of a step: what acts, what it leaves out of balance, what rounding hides."""
