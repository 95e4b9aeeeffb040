"""What parts named rigid strain by: asked for by stresses, and by nothing in a run."""
