"""Worlds that differ from what the scene states, and whether GO is shown on a wrong estimate; `__main__` has the command."""
