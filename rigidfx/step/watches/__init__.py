"""Attempts at a step, why one is repeated, and watches of accepted ones."""
