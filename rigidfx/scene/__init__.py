"""The whole problem, immutable and validated, and the instants at which its steps end."""
