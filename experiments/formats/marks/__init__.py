"""Marks that another tracker found: their covariances, times, values that repeat, and whether they lie as drawn.

Each is imported from its own module.
"""
