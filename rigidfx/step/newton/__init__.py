"""Newton's method for the equations of a step, with tangents that are kept where that pays."""
