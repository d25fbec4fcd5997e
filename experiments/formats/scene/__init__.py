"""Scene files: the tables of `scene.toml`, and the scene that they describe.

A new key needs a field in a table of `schema.py`, and code in the module that reads and writes that table.
"""
