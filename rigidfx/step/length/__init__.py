"""The length of a step by the error that it makes."""
