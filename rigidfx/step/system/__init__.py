"""What is bound to one division of the cells: supports, equations, a static preload."""
