"""Figures of results, with matplotlib.

What may enter: another figure, from what the pipeline or a simulation returns.
"""
