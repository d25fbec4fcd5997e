"""Meshes of bodies: files of others read and checked, surfaces filled, and the file of a project.

A new file format: its reader in `READERS` of `source.py`.
"""
