"""Shapes of the bodies of a run: those they begin with, and more as forces call for them."""
