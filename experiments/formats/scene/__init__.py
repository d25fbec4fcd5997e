"""Scene files: the tables of `scene.toml`, and the scene that they describe.

A new key: its field in a table of `schema.py`, and its meaning in the module that reads and writes that table.
"""
