"""Figures of results, with matplotlib.

What may enter: another figure, from what the pipeline or a simulation returns. Each is imported from its own module:
all of them load the filter, which takes a calibration's picture two seconds more.
"""
