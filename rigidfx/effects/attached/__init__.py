"""Attachments of nodes: springs, dashpots, masses."""
