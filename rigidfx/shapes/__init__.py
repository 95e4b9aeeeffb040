"""Shapes of reduced parts: which ones, from static responses of the whole structure."""
