"""The difference between a run with rigid parts and its flexible twin, as a motion of its own."""
