"""Meshes with named parts: boxes, arrays, gmsh's files and scripts, CAD."""
