"""Forces on the error motion: those that rigidity takes over at the nodes of bodies."""
