"""What a run tells of each of its steps."""
