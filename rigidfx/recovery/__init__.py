"""Strains of parts named rigid: asked for by stresses, and by nothing in a run."""
