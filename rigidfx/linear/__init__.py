"""Solvers of linear systems, and PETSc's options for them."""
