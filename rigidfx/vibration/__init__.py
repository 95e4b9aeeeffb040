"""Small vibrations about a state: modes, and damping given by two of them."""
