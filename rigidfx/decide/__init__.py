"""What is to become rigid or flexible: records and pure functions that change nothing."""
