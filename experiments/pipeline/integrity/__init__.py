"""Integrity of estimates: whether one may guide a needle, and which errors no mark shows.

What may enter: what is supposed where a scene states nothing. Mathematics belongs to `estimators.consistency`.
"""
