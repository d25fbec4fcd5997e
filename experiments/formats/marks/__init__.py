"""Marks from another tracker: covariances, times, repeated values, and comparison with the drawn shape.

Import names from the modules themselves.
"""
