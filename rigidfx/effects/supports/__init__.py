"""Supports: what holds or moves nodes."""
