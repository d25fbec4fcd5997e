"""Figures of results, with matplotlib.

A new figure belongs here.
"""

# Import names from the modules themselves: most modules load the filter, in two seconds; calibration.py does not.
