"""Recordings exported to other programs, and imported from them: `softaim export` and `softaim import`.

Formats are in `experiments/formats/exchange`. Each is imported from its own module.
"""
