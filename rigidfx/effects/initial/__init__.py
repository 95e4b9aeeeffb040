"""Initial motion and shape."""
