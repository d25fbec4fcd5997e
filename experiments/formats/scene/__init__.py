"""`scene.toml`: its schema, and the scene that it makes.

A new key: its field in `schema.py`, and its meaning where that table is read.
"""
