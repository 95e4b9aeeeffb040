"""Loads: dead ones, pressure, resultants of rigid bodies and of points of faces."""
