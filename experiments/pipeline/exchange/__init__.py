"""Recordings exported to other programs, and imported from them: `softaim export` and `softaim import`.

Formats are in `experiments/formats/exchange`. Import names from the modules themselves.
"""
