"""Recordings handed to other programs, and taken from them: what `softaim export` and `softaim import` do.

Formats are in `experiments/formats/exchange`. Each is imported from its own module.
"""
