"""Project folders from a template, and checks of scenes.

Help for a user's own phantom belongs here.
"""
