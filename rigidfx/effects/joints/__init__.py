"""Joints between parts: sides, pairs, and all joints of a division bound together."""
