"""Figures of results, with matplotlib.

A new figure belongs here.
"""

# Import each from its own module: most load the filter, which takes two seconds that a calibration's plot need not.
