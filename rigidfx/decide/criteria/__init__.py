"""Criteria: what a user writes, and the rules by which cells are judged."""
