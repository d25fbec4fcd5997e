"""Figures of results, with matplotlib.

Another figure belongs here.
"""

# Import each from its own module: all of them load the filter, which adds two seconds to a calibration's picture.
