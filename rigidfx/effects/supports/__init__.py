"""Supports: effects that hold or move nodes."""
