"""Checkpoints: all that a run remembers, in a file, for any number of ranks."""
