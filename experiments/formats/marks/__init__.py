"""Marks from another tracker: covariances, times, repeated values, and test against the drawing.

Each is imported from its own module.
"""
