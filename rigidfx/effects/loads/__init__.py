"""Loads: dead ones, pressure, resultants of rigid bodies, those of a static preload."""
