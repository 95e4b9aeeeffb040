"""The equations of a step: forces, their imbalance, and rounding."""
