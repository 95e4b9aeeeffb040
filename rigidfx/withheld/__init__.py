"""What bodies withhold: the forces at their nodes, and strains by them where asked for."""
