"""Parts of contact: penalty, obstacles, surfaces, friction, and the forces of them."""
