"""Meshes of bodies: readers and checks of mesh files, filling of surfaces, and the mesh file of a project.

The reader of a new file format belongs in `READERS` of `source.py`.
"""
