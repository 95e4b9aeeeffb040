"""Shadows of rigid bodies: how they would strain if they were flexible."""
