"""What flexible cells do: internal forces, strain rates, stresses, inversion."""
