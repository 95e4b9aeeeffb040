"""Decisions on parts that become rigid or flexible: records and functions that change nothing."""
