"""Project folders from a template, and checks of scenes.

New help for a user's own phantom belongs here.
"""
