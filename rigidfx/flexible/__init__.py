"""Flexible cells: internal forces, strain rates, stresses, inversion."""
