"""Which cells form bodies, and the mass of these."""
