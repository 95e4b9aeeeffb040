"""What drives the error motion: the forces that rigidity takes over at the nodes of bodies."""
