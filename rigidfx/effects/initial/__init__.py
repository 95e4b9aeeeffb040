"""What a motion begins with."""
