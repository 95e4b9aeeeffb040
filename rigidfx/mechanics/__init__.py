"""Mechanics without a mesh and without PETSc: materials, schemes, rotations, rigid bodies."""
