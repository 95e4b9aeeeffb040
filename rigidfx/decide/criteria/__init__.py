"""Criteria: the records of a user, and the rules by which cells are judged."""
