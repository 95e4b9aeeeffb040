"""What a policy remembers."""
