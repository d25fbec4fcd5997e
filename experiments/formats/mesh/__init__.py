"""Meshes of bodies: readers and checks of mesh files, filling of surfaces, and the mesh file of a project.

A new file format: its reader in `READERS` of `source.py`.
"""
