"""What is attached to nodes: springs, dashpots, masses."""
