"""Memory of a policy."""
