"""`scene.toml`: its tables, and the scene that they make.

A new key: its field in a table of `schema.py`, and its meaning in the module that reads and writes that table.
"""
