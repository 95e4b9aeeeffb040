"""Flexible dofs and rigid bodies in one system: dof layout, prolongation, condensation, mass."""
