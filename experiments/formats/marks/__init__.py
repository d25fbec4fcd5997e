"""Marks from another tracker: covariances, times, repeated values, and comparison with the drawing.

Import each from its own module.
"""
