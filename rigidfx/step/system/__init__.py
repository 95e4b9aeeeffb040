"""The parts bound to one division of the cells: supports, equations, those of statics."""
