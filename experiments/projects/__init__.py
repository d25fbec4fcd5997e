"""Project folders from a template, and checks of scenes.

What may enter: help for a user's own phantom.
"""
