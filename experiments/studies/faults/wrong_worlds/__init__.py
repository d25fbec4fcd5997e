"""Worlds that differ from what the scene states, and how often GO is wrong there; `__main__` has the command."""
