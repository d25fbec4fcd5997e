"""Figures of results, with matplotlib.

A new figure belongs here.
"""

# Import names from the modules themselves: most modules load the filter for two seconds, the calibration's does not.
