"""What contact is made of: penalty, obstacles, surfaces, friction, and the forces of them."""
