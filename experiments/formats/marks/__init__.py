"""Marks from another tracker: covariances, times, repeated values, and comparison with the drawing.

Import names from the modules themselves.
"""
