"""Errors raised on all ranks alike, checked input, text files, versions of DOLFINx."""
