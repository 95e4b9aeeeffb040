"""Which cells are flexible and which form bodies, and what bodies of cells weigh."""
