"""Damping of four kinds."""
